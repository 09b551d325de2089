"""Loops that run as machine code, compiled by Numba on their first call.

The code is kept on disk beside the module (or in the user's cache folder where that isn't
writable), so half a minute is paid once an installation, not once a run. Compiled functions
release the interpreter's lock: :mod:`bushseg.parallel` runs them on all cores.

What is kept is compiled anew when the function's own file has changed, and not when that of another
function has which it calls: whoever edits such a one deletes `__pycache__`.

They index without bounds checks. What they are given was checked before: they are called by the
module they stand in or the one above it, never with indices straight from a file.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])

# Sums may be taken in any order and a product joined with a sum: what vector instructions need.
# NaN and infinity keep their meaning.
_REORDER = {"contract", "reassoc", "nsz", "arcp"}


def compiled(function: Function) -> Function:
    """Compile a function whose floating-point operations are done as written."""
    return cast(Function, numba.njit(cache=True, nogil=True, error_model="numpy")(function))


def compiled_fast(function: Function) -> Function:
    """Compile a function whose sums may be reordered, so that they run in vector registers.

    Results then differ from the plain order's by rounding, and between processors likewise.
    """
    compile_function = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=_REORDER)
    return cast(Function, compile_function(function))
