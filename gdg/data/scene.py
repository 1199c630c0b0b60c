"""What an object of a grasp set stands on. Light: imports numpy alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gdg.data.table import Table


@dataclass(frozen=True)
class TableScene:
    """An object that rests on a table, in one of its stable poses.

    Grasps stay in the object's frame; the table is a half-space in it.

    Attributes:
        table: the table top.
        pose: which resting pose, 0 the most probable.
        probability: that the object comes to rest so when it is dropped in a random orientation.
    """

    table: Table
    pose: int
    probability: float

    @property
    def T_table_object(self) -> np.ndarray:
        """Pose of the object in the table's frame (z up, the origin below the object's), (4, 4)."""
        return np.linalg.inv(self.table.pose())

    def as_dict(self) -> dict[str, Any]:
        """Plain values; ``T_table_object`` follows from the table and is there for readers."""
        return {
            "name": "tabletop",
            "pose": self.pose,
            "probability": self.probability,
            "table": {"normal": list(self.table.normal), "offset": self.table.offset},
            "T_table_object": self.T_table_object.round(7).tolist(),
        }

    @classmethod
    def from_dict(cls, tree: dict[str, Any]) -> TableScene:
        """The inverse of ``as_dict``.

        Raises:
            KeyError, TypeError, ValueError: something is missing or malformed.
        """
        if tree["name"] != "tabletop":
            raise ValueError(f"there is no scene '{tree['name']}'")
        x, y, z = (float(value) for value in tree["table"]["normal"])
        table = Table((x, y, z), float(tree["table"]["offset"]))
        return cls(table, int(tree["pose"]), float(tree["probability"]))
