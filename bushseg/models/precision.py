"""How precisely matrices are multiplied.

Processors with matrix units for bfloat16 (Intel's AMX) multiply several times as fast as in
float32. Factors are then rounded to 8 bits of mantissa; sums, and all else, stay in float32.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch

from bushseg.config import Precision


def has_bfloat16_units() -> bool:
    """Whether this processor, and this PyTorch, multiply float32 matrices faster in bfloat16."""
    supported = getattr(torch.cpu, "_is_amx_tile_supported", None)
    return _setting() is not None and supported is not None and bool(supported())


@contextmanager
def multiplying_in(precision: Precision) -> Iterator[None]:
    """Multiply float32 matrices on the CPU in this precision, in all threads, for a while.

    Args:
        precision: "auto" takes bfloat16 where the processor has units for it.
    """
    setting = _setting()
    wanted = precision == "bfloat16" or (precision == "auto" and has_bfloat16_units())
    if setting is None or not wanted:
        yield
        return
    before = setting.fp32_precision
    setting.fp32_precision = "bf16"
    try:
        yield
    finally:
        setting.fp32_precision = before


def _setting() -> Any:
    """What PyTorch's products on the CPU go by; None before 2.9, which has no such setting."""
    matmul = getattr(torch.backends.mkldnn, "matmul", None)
    return matmul if hasattr(matmul, "fp32_precision") else None
