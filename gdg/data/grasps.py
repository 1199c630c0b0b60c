"""A set of grasps of one hand on one object, and its JSON file."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.data.atomic import write_text_atomically
from gdg.data.verdict import Verdict
from gdg.errors import GdgError

SCHEMA = "gdg-grasps-1"


@dataclass(frozen=True)
class GraspSet:
    """A batch of grasps of one hand-object pair; the object frame is the world frame.

    Attributes:
        hand: the hand's name.
        object_name: the object's name.
        joint_names: names of the columns of ``joints``.
        root_link: the link whose pose ``poses`` gives.
        poses: T_object_root, metres.
        joints: rad (m for prismatic joints).
        targets: joint values that the drives aim at when the grasp is tested, or None where
            they are the grasp's own.
        energies: name -> value per grasp; ``total`` is what the planner minimised.
        status: per grasp: ``converged``, ``diverged`` or ``hit_limit``.
        contact_values: the hand-made contact map per grasp, for pictures, or None.
        verdicts: per grasp, or empty when not simulated.
        provenance: component names, versions, hashes and seeds.
    """

    hand: str
    object_name: str
    joint_names: tuple[str, ...]
    root_link: str
    poses: Float[Tensor, "grasp 4 4"]
    joints: Float[Tensor, "grasp joint"]
    targets: Float[Tensor, "grasp joint"] | None = None
    energies: Mapping[str, Float[Tensor, "grasp"]] = field(default_factory=dict)
    status: tuple[str, ...] = ()
    contact_values: Float[Tensor, "grasp object_point"] | None = None
    verdicts: tuple[Verdict, ...] = ()
    provenance: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return self.poses.shape[0]

    def select(self, indices: Sequence[int]) -> GraspSet:
        """The grasps at the given indices, in that order, with all that belongs to them."""
        index = torch.as_tensor(list(indices), dtype=torch.long)

        def rows(values: Tensor | None) -> Tensor | None:
            return None if values is None else values[index.to(values.device)]

        return replace(
            self,
            poses=self.poses[index],
            joints=self.joints[index],
            targets=rows(self.targets),
            energies={name: values[index] for name, values in self.energies.items()},
            status=tuple(self.status[i] for i in index) if self.status else (),
            contact_values=rows(self.contact_values),
            verdicts=tuple(self.verdicts[i] for i in index) if self.verdicts else (),
        )

    @property
    def passed(self) -> list[int]:
        """Indices of the grasps whose verdict is success."""
        return [index for index, verdict in enumerate(self.verdicts) if verdict.success]

    def save(self, path: Path) -> None:
        """Writes ``grasps.json`` atomically: the file is either the old one or complete."""
        write_text_atomically(path, json.dumps(self.as_dict(), indent=1) + "\n")

    def as_dict(self) -> dict[str, Any]:
        """Plain values with named joints, units and 4×4 poses."""
        return {
            "schema": SCHEMA,
            "units": {"length": "m", "angle": "rad"},
            "hand": self.hand,
            "object": self.object_name,
            "root_link": self.root_link,
            "joint_names": list(self.joint_names),
            "provenance": self.provenance,
            "grasps": [self._grasp_as_dict(index) for index in range(len(self))],
        }

    def _grasp_as_dict(self, index: int) -> dict[str, Any]:
        def named(values: Tensor) -> dict[str, float]:
            return dict(zip(self.joint_names, _rounded(values[index]), strict=True))

        grasp: dict[str, Any] = {
            "T_object_root": [_rounded(row) for row in self.poses[index]],
            "joints": named(self.joints),
        }
        if self.targets is not None:
            grasp["joint_targets"] = named(self.targets)
        grasp["energies"] = {name: float(v[index]) for name, v in self.energies.items()}
        if self.status:
            grasp["status"] = self.status[index]
        if self.verdicts:
            grasp["verdict"] = self.verdicts[index].as_dict()
        return grasp


def load_grasps(path: Path) -> GraspSet:
    """Reads a ``grasps.json``; contact values are not stored and come back as None.

    Raises:
        GdgError: the file can't be read or isn't of this schema.
    """
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
        if tree.get("schema") != SCHEMA:
            raise GdgError(f"{path}: schema is '{tree.get('schema')}', expected '{SCHEMA}'.")
        return _from_dict(tree)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise GdgError(f"{path}: is no readable grasp file: {error}") from error


def _from_dict(tree: dict[str, Any]) -> GraspSet:
    names, grasps = tuple(tree["joint_names"]), tree["grasps"]

    def joints(key: str) -> Tensor:
        rows = [[grasp[key][name] for name in names] for grasp in grasps]
        return torch.tensor(rows, dtype=torch.float32).reshape(-1, len(names))

    energy_names = grasps[0]["energies"] if grasps else ()
    return GraspSet(
        hand=tree["hand"],
        object_name=tree["object"],
        joint_names=names,
        root_link=tree["root_link"],
        poses=torch.tensor([g["T_object_root"] for g in grasps]).float().reshape(-1, 4, 4),
        joints=joints("joints"),
        targets=joints("joint_targets") if grasps and "joint_targets" in grasps[0] else None,
        energies={n: torch.tensor([g["energies"][n] for g in grasps]) for n in energy_names},
        status=tuple(g["status"] for g in grasps if "status" in g),
        verdicts=tuple(Verdict.from_dict(g["verdict"]) for g in grasps if "verdict" in g),
        provenance=tree["provenance"],
    )


def _rounded(values: Tensor) -> list[float]:
    """Seven decimals: 0.1 µm and 0.1 µrad, below float32's own resolution at a metre."""
    return [round(float(value), 7) for value in values]
