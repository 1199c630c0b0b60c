"""A set of grasps of one hand on one object, and its JSON file."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.data.atomic import write_text_atomically
from gdg.data.contacts import ContactSet
from gdg.data.json_values import finite_or_none
from gdg.data.scene import TableScene
from gdg.data.verdict import Verdict
from gdg.errors import GdgError

SCHEMA = "gdg-grasps-1"
UNITS = {"length": "m", "angle": "rad"}


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
        metrics: name -> value per grasp: what was measured of the finished grasp (``gdg.quality``).
        contacts: where the hand touches the object, or None where it was not measured.
        status: per grasp: ``converged``, ``diverged`` or ``hit_limit``.
        contact_values: the hand-made contact map per grasp, for pictures, or None.
        verdicts: per grasp, or empty when not simulated.
        provenance: component names, versions, hashes and seeds.
        scene: what the object stands on; None: it floats in free air.
    """

    hand: str
    object_name: str
    joint_names: tuple[str, ...]
    root_link: str
    poses: Float[Tensor, "grasp 4 4"]
    joints: Float[Tensor, "grasp joint"]
    targets: Float[Tensor, "grasp joint"] | None = None
    energies: Mapping[str, Float[Tensor, "grasp"]] = field(default_factory=dict)
    metrics: Mapping[str, Float[Tensor, "grasp"]] = field(default_factory=dict)
    contacts: ContactSet | None = None
    status: tuple[str, ...] = ()
    contact_values: Float[Tensor, "grasp object_point"] | None = None
    verdicts: tuple[Verdict, ...] = ()
    provenance: dict[str, Any] = field(default_factory=dict)
    scene: TableScene | None = None

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
            metrics={name: values[index] for name, values in self.metrics.items()},
            contacts=None if self.contacts is None else self.contacts.select(index.tolist()),
            status=tuple(self.status[i] for i in index) if self.status else (),
            contact_values=rows(self.contact_values),
            verdicts=tuple(self.verdicts[i] for i in index) if self.verdicts else (),
        )

    @classmethod
    def joined(cls, parts: Sequence[GraspSet]) -> GraspSet:
        """All grasps of sets of one hand on one object, in order; of one set at least.

        What only some sets have is left out; provenance is the first one's.
        """
        first = parts[0]
        parts = [part for part in parts if len(part)] or [first]

        def stacked(values: list[Tensor | None]) -> Tensor | None:
            given = [value for value in values if value is not None]
            return torch.cat(given) if len(given) == len(parts) else None

        def together(values: list[tuple[Any, ...]]) -> tuple[Any, ...]:
            return tuple(one for of_part in values for one in of_part) if all(values) else ()

        def columns(tables: list[Mapping[str, Tensor]]) -> dict[str, Tensor]:
            shared = [name for name in tables[0] if all(name in table for table in tables)]
            return {name: torch.cat([table[name] for table in tables]) for name in shared}

        contacts = [part.contacts for part in parts if part.contacts is not None]
        return replace(
            first,
            poses=torch.cat([part.poses for part in parts]),
            joints=torch.cat([part.joints for part in parts]),
            targets=stacked([part.targets for part in parts]),
            energies=columns([part.energies for part in parts]),
            metrics=columns([part.metrics for part in parts]),
            contacts=ContactSet.joined(contacts) if len(contacts) == len(parts) else None,
            status=together([part.status for part in parts]),
            contact_values=stacked([part.contact_values for part in parts]),
            verdicts=together([part.verdicts for part in parts]),
        )

    @property
    def passed(self) -> list[int]:
        """Indices of the grasps whose verdict is success."""
        return [index for index, verdict in enumerate(self.verdicts) if verdict.success]

    def save(self, path: Path | str) -> None:
        """Writes ``grasps.json`` atomically: the file is either the old one or complete."""
        write_text_atomically(Path(path), json.dumps(self.as_dict(), indent=1) + "\n")

    def as_dict(self) -> dict[str, Any]:
        """Plain values with named joints, units and 4×4 poses; what is not finite is None."""
        return {
            "schema": SCHEMA,
            "units": UNITS,
            "hand": self.hand,
            "object": self.object_name,
            "root_link": self.root_link,
            "joint_names": list(self.joint_names),
            **({} if self.scene is None else {"scene": self.scene.as_dict()}),
            "provenance": finite_or_none(self.provenance),
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
        for key, columns in (("energies", self.energies), ("metrics", self.metrics)):
            grasp[key] = {n: finite_or_none(float(v[index])) for n, v in columns.items()}
        if self.contacts is not None:
            grasp["contacts"] = self.contacts.as_dicts(index)
        if self.status:
            grasp["status"] = self.status[index]
        if self.verdicts:
            grasp["verdict"] = self.verdicts[index].as_dict()
        return grasp


def load_grasps(path: Path | str) -> GraspSet:
    """Reads a ``grasps.json``; contact values are not stored and come back as None.

    Raises:
        GdgError: the file can't be read, isn't of this schema, or a pose is not rigid.
    """
    path = Path(path)
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
        if tree.get("schema") != SCHEMA:
            raise GdgError(f"{path}: schema is '{tree.get('schema')}', expected '{SCHEMA}'.")
        if tree.get("units") != UNITS:
            raise GdgError(f"{path}: units are {tree.get('units')}, expected {UNITS}.")
        grasps = _from_dict(tree)
    except OSError as error:
        raise GdgError(f"{path}: cannot be read: {error.strerror or error}.") from error
    except KeyError as error:
        raise GdgError(f"{path}: is no readable grasp file: {error} is missing.") from error
    except (ValueError, TypeError, AttributeError, RuntimeError) as error:
        raise GdgError(f"{path}: is no readable grasp file: {error}") from error
    _check_poses(path, grasps)
    return grasps


def _from_dict(tree: dict[str, Any]) -> GraspSet:
    names, grasps = tuple(tree["joint_names"]), tree["grasps"]
    first = grasps[0] if grasps else {}

    def joints(key: str) -> Tensor:
        rows = [[grasp[key][name] for name in names] for grasp in grasps]
        return torch.tensor(rows, dtype=torch.float32).reshape(len(grasps), len(names))

    def columns(key: str) -> dict[str, Tensor]:
        table = {name: [grasp[key][name] for grasp in grasps] for name in first.get(key, ())}
        return {
            name: torch.tensor([math.nan if v is None else v for v in values], dtype=torch.float32)
            for name, values in table.items()
        }

    poses = torch.tensor([grasp["T_object_root"] for grasp in grasps], dtype=torch.float32)
    if grasps and poses.shape[1:] != (4, 4):
        raise ValueError("T_object_root must be a 4×4 matrix")
    return GraspSet(
        hand=tree["hand"],
        object_name=tree["object"],
        joint_names=names,
        root_link=tree["root_link"],
        poses=poses.reshape(-1, 4, 4),
        joints=joints("joints"),
        targets=joints("joint_targets") if "joint_targets" in first else None,
        energies=columns("energies"),
        metrics=columns("metrics"),
        contacts=(
            ContactSet.from_dicts([grasp["contacts"] for grasp in grasps])
            if "contacts" in first
            else None
        ),
        status=tuple(g["status"] for g in grasps) if "status" in first else (),
        verdicts=(
            tuple(Verdict.from_dict(g["verdict"]) for g in grasps) if "verdict" in first else ()
        ),
        provenance=tree["provenance"],
        scene=TableScene.from_dict(tree["scene"]) if "scene" in tree else None,
    )


def _check_poses(path: Path, grasps: GraspSet) -> None:
    rotation = grasps.poses[:, :3, :3]
    off = (rotation @ rotation.mT - torch.eye(3)).abs().amax((1, 2))
    last_row = (grasps.poses[:, 3] - torch.tensor([0.0, 0.0, 0.0, 1.0])).abs().amax(1)
    fine = (off < 1e-3) & (torch.linalg.det(rotation) > 0) & (last_row < 1e-6)
    fine &= grasps.poses.isfinite().all(-1).all(-1) & grasps.joints.isfinite().all(-1)
    if not fine.all():
        index = int((~fine).nonzero()[0])
        raise GdgError(
            f"{path}: grasp {index}: T_object_root is no rigid pose (is it transposed?), or a "
            f"joint value is not finite."
        )


def _rounded(values: Tensor) -> list[float]:
    """Seven decimals: 0.1 µm and 0.1 µrad, below float32's own resolution at a metre."""
    return [round(float(value), 7) for value in values]
