"""Contact points of a batch of grasps: a different number per grasp."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor


@dataclass(frozen=True)
class ContactSet:
    """Where hands touch an object; contacts of one grasp stand together, grasps in order.

    Attributes:
        counts: contacts of each grasp.
        links: the hand's link, per contact.
        points: on the object's surface, object frame, metres.
        normals: outward unit normals of the object there.
        gaps: from the object to the link, metres; negative where they overlap.
    """

    counts: Int[Tensor, "grasp"]
    links: tuple[str, ...]
    points: Float[Tensor, "contact 3"]
    normals: Float[Tensor, "contact 3"]
    gaps: Float[Tensor, "contact"]

    def __len__(self) -> int:
        return len(self.counts)

    def rows(self, grasp: int) -> slice:
        """The contacts of one grasp."""
        end = int(self.counts[: grasp + 1].sum())
        return slice(end - int(self.counts[grasp]), end)

    def select(self, grasps: Sequence[int]) -> ContactSet:
        """The contacts of the given grasps, in that order."""
        ends = self.counts.cumsum(0).tolist()
        counts = self.counts.tolist()
        rows = [row for grasp in grasps for row in range(ends[grasp] - counts[grasp], ends[grasp])]
        index = torch.as_tensor(rows, dtype=torch.long)
        return ContactSet(
            self.counts[torch.as_tensor(list(grasps), dtype=torch.long)],
            tuple(self.links[row] for row in rows),
            self.points[index],
            self.normals[index],
            self.gaps[index],
        )

    @classmethod
    def joined(cls, parts: Sequence[ContactSet]) -> ContactSet:
        """The contacts of the grasps of all parts, in order."""
        return cls(
            torch.cat([part.counts for part in parts]),
            tuple(link for part in parts for link in part.links),
            torch.cat([part.points for part in parts]),
            torch.cat([part.normals for part in parts]),
            torch.cat([part.gaps for part in parts]),
        )

    def as_dicts(self, grasp: int) -> list[dict[str, Any]]:
        """The contacts of one grasp as plain values."""
        rows = self.rows(grasp)
        columns = (self.points[rows], self.normals[rows], self.gaps[rows])
        return [
            {"link": link, "point": _rounded(point), "normal": _rounded(normal), "gap": gap}
            for link, point, normal, gap in zip(
                self.links[rows], *(column.tolist() for column in columns), strict=True
            )
        ]

    @staticmethod
    def from_dicts(grasps: Sequence[Sequence[Mapping[str, Any]]]) -> ContactSet:
        """What ``as_dicts`` of every grasp gave."""
        flat = [contact for contacts in grasps for contact in contacts]

        def column(name: str, *shape: int) -> Tensor:
            values = [contact[name] for contact in flat]
            return torch.tensor(values, dtype=torch.float32).reshape(len(flat), *shape)

        return ContactSet(
            torch.tensor([len(contacts) for contacts in grasps], dtype=torch.long),
            tuple(contact["link"] for contact in flat),
            column("point", 3),
            column("normal", 3),
            column("gap"),
        )

    @staticmethod
    def join(sets: Sequence[ContactSet]) -> ContactSet:
        """The contacts of several batches, one after the other."""
        return ContactSet(
            torch.cat([s.counts for s in sets]),
            tuple(link for s in sets for link in s.links),
            torch.cat([s.points for s in sets]),
            torch.cat([s.normals for s in sets]),
            torch.cat([s.gaps for s in sets]),
        )


def _rounded(values: Sequence[float]) -> list[float]:
    return [round(value, 7) for value in values]
