"""Distance metric: how far a hand is from each surface point of an object."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from jaxtyping import Float, Int
from torch import Tensor

from gdg.components import Options


@dataclass(frozen=True)
class HandDistance:
    """Distance of every object point to the hand.

    Attributes:
        distance: in the metric's own unit (metres for euclidean, metres^½ for aligned).
        hand_index: the hand point that attains the minimum (the lowest index on ties).
    """

    distance: Float[Tensor, "batch object_point"]
    hand_index: Int[Tensor, "batch object_point"]


class Distance(ABC):
    """A metric between object points and a hand's surface, with its contact value.

    Args:
        options: the component's options.
    """

    #: ``name/preset``, and ``-option0.5`` for an option that changes the values; written into every
    #: contact map.
    label: str

    def __init__(self, options: Options):
        self.options = options

    @abstractmethod
    def to_hand(
        self,
        object_points: Float[Tensor, "object_point 3"],
        object_normals: Float[Tensor, "object_point 3"],
        hand_points: Float[Tensor, "batch hand_point 3"],
        hand_index: Int[Tensor, "batch object_point"] | None = None,
    ) -> HandDistance:
        """The minimum over hand points, differentiable in ``hand_points``.

        Gradients flow through the selected pair only. Never materialises object × hand × 3.
        All points in one frame, metres; normals are outward unit vectors.

        Args:
            object_points: metres.
            object_normals: outward unit normals.
            hand_points: metres.
            hand_index: take the distance to these hand points and search for none, e.g. those of
                a pose nearby.
        """

    @abstractmethod
    def contact_value(self, distance: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
        """Contact value in (0, 1] of distances as ``to_hand`` gives them; 1 at distance 0."""

    @abstractmethod
    def aligned_gap(self, value: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
        """Gap in metres along the outward normal at which a contact value would arise.

        The inverse of ``contact_value`` for aligned points: it lets maps made with one metric be
        rewritten in another.
        """

    @abstractmethod
    def of_gap(self, gap: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
        """Distance of a hand point straight out along the normal, ``gap`` metres away."""

    def sharpen(self, values: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
        """Contact values with contacts made definite, as the source prescribes; default: as is."""
        return values
