# SPDX-License-Identifier: Apache-2.0
"""Errors that a user can mend, and what a user should know."""


class InputWarning(UserWarning):
    """Something a person gave us was understood in another way than it is written there."""


class InputError(ValueError):
    """Something a person gave us is wrong; the message is one line and says what is allowed.

    The command line prints the message alone and leaves with exit code 2.
    """
