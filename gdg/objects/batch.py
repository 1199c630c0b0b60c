"""Several objects side by side, so that one call works on hands around all of them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.data.table import Table
from gdg.geometry.sdf_stack import SdfStack
from gdg.objects.model import ObjectModel


class ObjectBatch:
    """Objects that share one batch of hands: equally many hands per object, object by object.

    So of 6 hands around 2 objects, hands 0 to 2 are around object 0. A single object is a batch of
    one. An object may stand here twice.

    Args:
        objects: at least one, all on one device.

    Attributes:
        objects: as given.
        sdf: signed distance of each hand's own object; what it takes of memory is said there.
    """

    def __init__(self, objects: Sequence[ObjectModel]):
        self.objects = tuple(objects)
        self.sdf = SdfStack.of([obj.sdf for obj in self.objects])

    def __len__(self) -> int:
        return len(self.objects)

    @property
    def tables(self) -> tuple[Table | None, ...]:
        """The table that each rests on."""
        return tuple(obj.table for obj in self.objects)

    @cached_property
    def centers_of_mass(self) -> Float[Tensor, "object 3"]:
        """Centre of mass of each, metres."""
        return torch.stack([obj.center_of_mass for obj in self.objects])

    @cached_property
    def reaches(self) -> Float[Tensor, "object"]:
        """Radius of each around its centre of mass, metres."""
        return self.centers_of_mass.new_tensor([obj.reach for obj in self.objects])

    def per_hand(
        self, values: Float[Tensor, "object *rest"], hands: int
    ) -> Float[Tensor, "hand *rest"]:
        """What belongs to objects, for each of so many hands in all."""
        each = hands // len(self)
        return values[:, None].expand(-1, each, *values.shape[1:]).flatten(0, 1)

    def per_object(self, rows: Tensor) -> Tensor:
        """Rows of hands, (object × hand, …), as (object, hand, …)."""
        return rows.reshape(len(self), len(rows) // len(self), *rows.shape[1:])
