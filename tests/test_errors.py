# SPDX-License-Identifier: Apache-2.0
"""What is said of strangers' files stays one line, and no terminal's command."""

from __future__ import annotations

import pickle
import warnings

import pytest

from pm01_nav.errors import InputError, InputWarning


@pytest.mark.parametrize("kind", [InputError, InputWarning])
def test_a_name_with_line_breaks_and_escapes_is_one_line(kind):
    error = kind("world 'a\r\nb\x1b[2J\u2028': no such file, Größe 世界")
    assert str(error) == "world 'a  b [2J ': no such file, Größe 世界"
    # As it comes back from another process.
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


def test_a_warning_is_one_line():
    with pytest.warns(InputWarning, match="^a b$"):
        warnings.warn("a\nb", InputWarning, stacklevel=1)
