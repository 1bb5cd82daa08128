# SPDX-License-Identifier: Apache-2.0
"""Say in one line that a training diverged, wherever that shows first."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from pm01_nav.errors import InputError

REFUSED = ("Expected parameter ", "Expected value argument ", "actions must be finite")
"""How torch's distributions and our environments begin to complain of what is not finite."""


def check_finite(policy: Any, algorithm: str) -> None:
    """Make sure that an update left a policy that can go on.

    Raises:
        InputError: a weight is NaN or infinite.
    """
    if not _is_finite(policy):
        raise _diverged(algorithm)


@contextmanager
def divergence_told(policy: Any, algorithm: str) -> Iterator[None]:
    """Say so if the learner fails because its training diverged, as it may within an update.

    Raises:
        InputError: it did.
    """
    try:
        yield
    except ValueError as error:
        # Weights may be finite and so large that what comes of them is not.
        refused = str(error).startswith(REFUSED)
        if refused or not (isinstance(error, InputError) or _is_finite(policy)):
            raise _diverged(algorithm) from error
        raise


def _is_finite(policy: Any) -> bool:
    return all(bool(weights.isfinite().all()) for weights in policy.parameters())


def _diverged(algorithm: str) -> InputError:
    return InputError(
        f"training diverged: the policy is not finite any more; "
        f"lower train.{algorithm}.learning_rate"
    )
