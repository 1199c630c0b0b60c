"""Small datasets: grasps with every part, and shards as the first schema had them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import torch
from grasp_samples import make_verdict

from gdg.data.contacts import ContactSet
from gdg.data.grasps import GraspSet
from gdg.data.shards import shard_path
from gdg.data.verdict import Verdict
from gdg.rotations import random_rotations

HAND_HASH, OBJECT_HASH = "a" * 64, "b" * 64
FACTS = {"hand_hash": HAND_HASH, "object_hash": OBJECT_HASH, "split": "train"}


def sample_verdict(success: bool) -> Verdict:
    """A verdict whose figures don't matter."""
    return make_verdict(
        success,
        failure="" if success else "moved",
        drift_m=0.0,
        rotation_rad=(0.0,) * 6,
        penetration_start_mm=0.5,
        penetration_end_mm=0.25,
        free_displacement_m=0.25,
        shift_successes=(success,),
        engine="none",
        refined=False,
    )


def sample_contacts(counts: Sequence[int], random: torch.Generator) -> ContactSet:
    """Contacts of two links, as many per grasp as given."""
    total = sum(counts)
    return ContactSet(
        torch.tensor(list(counts), dtype=torch.long),
        tuple(("thumb", "fingér tip")[index % 2] for index in range(total)),
        torch.randn(total, 3, generator=random),
        torch.randn(total, 3, generator=random),
        torch.randn(total, generator=random),
    )


def sample_grasps(
    count: int = 3,
    *,
    hand: str = "claw",
    object_name: str = "cube",
    joints: int = 2,
    seed: int = 0,
    parts: Sequence[str] = ("targets", "status", "contacts", "verdicts", "figures"),
    every_nth_passes: int = 2,
) -> GraspSet:
    """Grasps at random poses, with the named parts."""
    random = torch.Generator().manual_seed(seed)
    poses = torch.eye(4).repeat(count, 1, 1)
    poses[:, :3, :3] = random_rotations(count, random)
    poses[:, :3, 3] = torch.randn(count, 3, generator=random)
    values = torch.rand(count, joints, generator=random)
    given: dict[str, Any] = {
        "targets": torch.rand(count, joints, generator=random),
        "status": tuple(("converged", "hit_limit")[index % 2] for index in range(count)),
        "contacts": sample_contacts([index % 3 for index in range(count)], random),
        "verdicts": tuple(sample_verdict(i % every_nth_passes == 0) for i in range(count)),
    }
    given = {name: value for name, value in given.items() if name in parts}
    if "figures" in parts:
        given["energies"] = {"total": torch.rand(count, generator=random)}
        given["metrics"] = {"epsilon": torch.rand(count, generator=random)}
    names = tuple(f"joint {index}" for index in range(joints))
    return GraspSet(
        hand, object_name, names, "palm", poses, values, provenance={"seed": 1}, **given
    )


def write_old_shard(root: Path, key: str, grasps: GraspSet, facts: dict[str, Any]) -> Path:
    """A shard as the first schema had it."""
    numbers = pa.list_(pa.float32())
    columns = {
        "joints": pa.array(grasps.joints.tolist(), numbers),
        "pose": pa.array(grasps.poses.flatten(1).tolist(), numbers),
    }
    if grasps.targets is not None:
        columns["targets"] = pa.array(grasps.targets.tolist(), numbers)
    for name, values in grasps.energies.items():
        columns[f"energy_{name}"] = pa.array(values.tolist(), pa.float32())
    if grasps.status:
        columns["status"] = pa.array(grasps.status, pa.string())
    if grasps.verdicts:
        columns["success"] = pa.array([v.success for v in grasps.verdicts], pa.bool_())
        texts = [json.dumps(verdict.as_dict()) for verdict in grasps.verdicts]
        columns["verdict"] = pa.array(texts, pa.string())
    header = {
        "schema": "gdg-dataset-1",
        "hand": grasps.hand,
        "object": grasps.object_name,
        "joint_names": list(grasps.joint_names),
        "root_link": grasps.root_link,
        **facts,
        "provenance": grasps.provenance,
    }
    table = pa.table(columns).replace_schema_metadata({b"gdg": json.dumps(header).encode()})
    path = shard_path(root, grasps.hand, grasps.object_name, key)
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, path, compression="zstd")
    return path


def assert_same_grasps(first: GraspSet, second: GraspSet) -> None:
    """Every part is equal to the bit; NaN equals NaN."""
    for name in ("hand", "object_name", "joint_names", "root_link", "status", "verdicts"):
        assert getattr(first, name) == getattr(second, name), name
    for name in ("poses", "joints", "targets"):
        _assert_equal(getattr(first, name), getattr(second, name))
    for name in ("energies", "metrics"):
        ours, theirs = getattr(first, name), getattr(second, name)
        assert ours.keys() == theirs.keys()
        for key in ours:
            _assert_equal(ours[key], theirs[key])
    assert (first.contacts is None) == (second.contacts is None)
    if first.contacts is not None and second.contacts is not None:
        assert first.contacts.links == second.contacts.links
        for name in ("counts", "points", "normals", "gaps"):
            _assert_equal(getattr(first.contacts, name), getattr(second.contacts, name))


def _assert_equal(first: torch.Tensor | None, second: torch.Tensor | None) -> None:
    assert (first is None) == (second is None)
    if first is not None and second is not None:
        assert first.shape == second.shape
        torch.testing.assert_close(first, second, rtol=0, atol=0, equal_nan=True)
