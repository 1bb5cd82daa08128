# SPDX-License-Identifier: Apache-2.0
"""Teach numba-cuda the numpy functions of our kernels that it does not know."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba.cuda import mathimpl, ufuncs

from pm01_nav.compilation import patched

Lowering = Callable[[Any, ir.IRBuilder, Any, Any], ir.Value]


def teach() -> None:
    """Enter the missing functions in numba-cuda's table; what it knows stays as it is."""
    if not hasattr(np, "row_stack"):
        # numba-cuda 0.30 names it while it loads; numpy 2.5 has it no more.
        with patched(np, "row_stack", np.vstack):
            importlib.import_module("numba.cuda.np.arrayobj")
    table = ufuncs.ufunc_db()
    for function, like in (
        (np.floor, math.floor),
        (np.ceil, math.ceil),
        (np.sqrt, math.sqrt),
        (np.exp, math.exp),
        (np.log1p, math.log1p),
    ):
        table.setdefault(function, dict.fromkeys(("f->f", "d->d"), _like(like)))
    table.setdefault(np.sign, dict.fromkeys(("f->f", "d->d"), _sign))


def _like(function: Callable[[float], float]) -> Lowering:
    """Return what calls the GPU's own version of a function of ``math``."""

    def lower(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        implementation = mathimpl.get_unary_impl_for_fn_and_ty(function, sig.args[0])
        return implementation(context, builder, sig, args)

    return lower


def _sign(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
    """Return -1, 0 or 1; what is NaN stays so."""
    value = args[0]
    zero, one = ir.Constant(value.type, 0.0), ir.Constant(value.type, 1.0)
    below = builder.fcmp_ordered("<", value, zero)
    above = builder.fcmp_ordered(">", value, zero)
    negative = ir.Constant(value.type, -1.0)
    return builder.select(above, one, builder.select(below, negative, value))
