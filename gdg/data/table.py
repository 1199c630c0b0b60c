"""The table that an object rests on while the hand closes. Light: imports numpy alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: A normal's length may be this far from 1.
UNIT_TOLERANCE = 1e-3


@dataclass(frozen=True)
class Table:
    """A table top in the object's frame: points with ``normal · x < offset`` are table.

    Attributes:
        normal: unit vector out of the table, against gravity.
        offset: distance of the surface from the object's origin along ``normal``, metres;
            negative where the origin lies above the table.
    """

    normal: tuple[float, float, float]
    offset: float

    def __post_init__(self) -> None:
        length = float(np.linalg.norm(self.normal))
        if not (abs(length - 1.0) <= UNIT_TOLERANCE and np.isfinite(self.offset)):
            raise ValueError(f"a table needs a unit normal and a finite offset, not {self}")

    @property
    def up(self) -> np.ndarray:
        """The normal as an array, of length 1."""
        normal = np.asarray(self.normal, np.float64)
        return normal / np.linalg.norm(normal)

    def pose(self, lowered: float = 0.0) -> np.ndarray:
        """T_object_table: z along the normal, the origin on the surface below the object's.

        Args:
            lowered: how far the table has moved away, against its normal, metres.
        """
        up = self.up
        helper = np.eye(3)[np.argmin(np.abs(up))]
        x = np.cross(helper, up)
        x /= np.linalg.norm(x)
        T = np.eye(4)
        T[:3, :3] = np.stack((x, np.cross(up, x), up), axis=1)
        T[:3, 3] = (self.offset - lowered) * up
        return T
