# SPDX-License-Identifier: Apache-2.0
"""Errors that a user can mend, and what a user should know."""


class _OneLine(Exception):  # noqa: N818  # warnings are, too
    """What is said in one line: names in strangers' files may hold line breaks and escapes."""

    def __init__(self, message: object) -> None:
        super().__init__("".join(c if c.isprintable() else " " for c in str(message)))


class InputWarning(_OneLine, UserWarning):
    """Something a person gave us was understood in another way than it is written there."""


class InputError(_OneLine, ValueError):
    """Something a person gave us is wrong; the message is one line and says what is allowed.

    The command line prints the message alone and leaves with exit code 2.
    """
