"""Grasps are checked against the hand and the object that are found now."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from gripper import write_gripper

from gdg.data.dataset import shards, write_shard
from gdg.data.findings import FileFinding
from gdg.data.grasps import GraspSet
from gdg.hands.hand import Hand, load_hand
from gdg.identity import object_hash
from gdg.pipeline.data_checks import AssetChecks


@pytest.fixture
def hand(tmp_path: Path) -> Hand:
    return load_hand(write_gripper(tmp_path / "hands"))


def grasps(hand: Hand) -> GraspSet:
    lower, upper = (torch.from_numpy(limit).float() for limit in hand.limits())
    poses = torch.eye(4).repeat(3, 1, 1)
    middle = ((lower + upper) / 2).repeat(3, 1)
    spec = hand.spec
    return GraspSet("two_jaws", "cube_small", spec.joints, spec.root_link, poses, middle)


def findings(root: Path, hand: Hand, made: GraspSet, **facts: str) -> list[FileFinding]:
    given = {
        "hand_hash": hand.content_hash,
        "object_hash": object_hash("cube_small"),
        "split": "train",
        "hand_path": str(hand.folder),
    }
    write_shard(root, "k", made, {**given, **facts})
    checks = AssetChecks()
    (info,) = shards(root)
    first = list(checks(info, made))
    # what concerns the whole hand or object is told once
    assert all(finding.severity == "error" for finding in checks(info, made))
    return first


def test_grasps_of_the_hand_and_object_that_are_found_are_fine(hand: Hand, tmp_path: Path):
    assert findings(tmp_path / "d", hand, grasps(hand)) == []


def test_joints_beyond_their_limits_are_found(hand: Hand, tmp_path: Path):
    made = grasps(hand)
    joints = made.joints.clone()
    joints[1, 0] = float(hand.limits()[1][0]) + 0.5
    joints[2, 0] = float(hand.limits()[1][0]) + 1e-4
    (finding,) = findings(tmp_path / "d", hand, replace(made, joints=joints))
    assert (finding.severity, finding.damaged) == ("error", False)
    assert "1 of 3 grasps exceed joint limits, most by 0.5" in finding.text
    assert f"{hand.spec.joints[0]} in row 1" in finding.text


def test_other_joints_or_another_root_are_found(hand: Hand, tmp_path: Path):
    made = grasps(hand)
    swapped = replace(made, joint_names=tuple(f"other {name}" for name in made.joint_names))
    (finding,) = findings(tmp_path / "a", hand, swapped)
    assert f"those of two_jaws are {', '.join(hand.spec.joints)}" in finding.text
    (finding,) = findings(tmp_path / "b", hand, replace(made, root_link="elsewhere"))
    assert "'elsewhere'" in finding.text


def test_other_versions_and_what_is_not_found_are_warnings(hand: Hand, tmp_path: Path):
    made = grasps(hand)
    found = findings(tmp_path / "a", hand, made, hand_hash="0" * 64, object_hash="0" * 64)
    assert [finding.severity for finding in found] == ["warning", "warning"]
    assert all("has another content" in finding.text for finding in found)
    found = findings(tmp_path / "b", hand, made, hand_path="/no/where", object_path="/no/where.stl")
    assert all("is not found here" in finding.text for finding in found)
    assert len(found) == 2
