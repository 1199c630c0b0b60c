"""A contact map: how close a hand is to each surface point of an object."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class ContactMap:
    """A batch of contact maps on the surface points of one object.

    Attributes:
        object_name: the object that the maps lie on.
        values: contact values in [0, 1], one row per map, columns in the order of
            ``ObjectModel.points``; 1 is contact.
        distance: ``name/preset`` of the distance that the values were made with, e.g.
            ``aligned/release``: a fitter must use the same.
        provenance: generator, weights hash, seed.
    """

    object_name: str
    values: Float[Tensor, "map object_point"]
    distance: str
    provenance: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return self.values.shape[0]
