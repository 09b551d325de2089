"""The one type that travels from readers to writers."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
AttributeArray = NDArray[Any]


@dataclass(frozen=True, slots=True)
class PointCloud:
    """Points with every attribute their file gave them, under its own name.

    Attributes:
        xyz: Coordinates in metres (or the CRS's unit), shape (N, 3), float64. May hold NaN.
        attributes: Further columns, each of length N, in the file's own dtype and under the file's
            own name; a multi-valued column has shape (N, M).
        record: The format's own record of these points (for LAS, the raw point record), which lets
            a writer of the same format copy what it doesn't interpret. None when there is none.
    """

    xyz: FloatArray
    attributes: dict[str, AttributeArray] = field(default_factory=dict)
    record: Any = None

    def __post_init__(self) -> None:
        if self.xyz.ndim != 2 or self.xyz.shape[1] != 3 or self.xyz.dtype != np.float64:
            raise ValueError(f"xyz is {self.xyz.shape} {self.xyz.dtype}; expected (N, 3) float64")
        for name, column in self.attributes.items():
            if len(column) != len(self.xyz):
                raise ValueError(
                    f"attribute {name!r} has {len(column)} values for {len(self.xyz)} points"
                )

    def __len__(self) -> int:
        return len(self.xyz)
