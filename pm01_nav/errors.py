# SPDX-License-Identifier: Apache-2.0
"""Errors that a user can mend."""


class InputError(ValueError):
    """Something a person gave us is wrong; the message is one line and says what is allowed.

    The command line prints the message alone and leaves with exit code 2.
    """
