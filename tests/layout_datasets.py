"""Datasets of random grasps, for tests of the layouts; no grasp of them holds anything."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import torch

from gdg.data.dataset import read_shard, shards, write_shard
from gdg.data.grasps import GraspSet
from gdg.data.verdict import Verdict
from gdg.hands.hand import Hand
from gdg.rotations import random_rotations


def random_grasps(hand: Hand, object_name: str, count: int, seed: int = 0) -> GraspSet:
    """Random poses near the object and random joints within their limits, untested."""
    random = torch.Generator().manual_seed(seed)
    poses = torch.eye(4).repeat(count, 1, 1)
    poses[:, :3, :3] = random_rotations(count, random)
    poses[:, :3, 3] = 0.1 * torch.randn(count, 3, generator=random)
    lower, upper = (torch.as_tensor(limit, dtype=torch.float32) for limit in hand.limits())
    share = torch.rand(count, len(hand.spec.joints), generator=random)
    return GraspSet(
        hand=hand.name,
        object_name=object_name,
        joint_names=hand.spec.joints,
        root_link=hand.spec.root_link,
        poses=poses,
        joints=lower + share * (upper - lower),
        energies={"total": torch.rand(count, generator=random), "fc": torch.rand(count)},
        status=("converged",) * count,
        provenance={"seed": seed, "gdg": "0", "components": {"planner": {"name": "made-up"}}},
    )


def verdict(success: bool, protocol: str = "dro-2024-v1") -> Verdict:
    """A verdict of three trials, of which two gave the answer."""
    return Verdict(
        success=success,
        failure="" if success else "moved",
        displacement_m=(0.001,) * 6,
        rotation_rad=(0.0,) * 6,
        drift_m=0.002,
        contact_kept=(True,) * 6,
        penetration_start_mm=0.5,
        penetration_end_mm=0.1,
        free_displacement_m=0.25,
        shift_successes=(success, not success, success),
        protocol=protocol,
        engine="sapien 3.0.3",
        refined=True,
        seconds=0.1,
        trials=3,
    )


def with_verdicts(grasps: GraspSet, failing: int = 1, protocol: str = "dro-2024-v1") -> GraspSet:
    """The same grasps with verdicts; the first ``failing`` failed."""
    verdicts = tuple(verdict(index >= failing, protocol) for index in range(len(grasps)))
    return replace(grasps, targets=grasps.joints + 0.001, verdicts=verdicts)


def write_dataset(
    root: Path, hand: Hand, hashes: Mapping[str, str], count: int, tested: bool = True
) -> Path:
    """Writes one shard per object (name -> content hash) and returns the folder."""
    for seed, (name, object_hash) in enumerate(hashes.items()):
        grasps = random_grasps(hand, name, count, seed)
        facts = {
            "hand_hash": hand.content_hash,
            "object_hash": object_hash,
            "split": "train",
            "hand_path": str(hand.folder),
            "shard_seed": 100 + seed,
        }
        write_shard(root, f"k{seed}", with_verdicts(grasps) if tested else grasps, facts)
    return root


def grasps_in(root: Path) -> dict[tuple[str, str], GraspSet]:
    """(hand, object) -> its grasps; every pair has one shard."""
    return {(info.hand, info.object_name): read_shard(info.path) for info in shards(root)}


def assert_same_grasps(found: GraspSet, expected: GraspSet) -> None:
    """Same hand, object, joints to 1e-7 and poses to 1e-6, in the same order."""
    names = ("hand", "object_name", "joint_names", "root_link")
    assert [getattr(found, n) for n in names] == [getattr(expected, n) for n in names]
    torch.testing.assert_close(found.poses, expected.poses, atol=1e-6, rtol=0)
    torch.testing.assert_close(found.joints, expected.joints, atol=1e-7, rtol=0)
