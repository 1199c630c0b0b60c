"""The oracle generator gives the maps of the grasps in its file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from gdg_plugins.generator_oracle.generator import OracleGenerator
from gdg_plugins.generator_oracle.options import OracleOptions

from gdg.contact_maps import contact_map_of
from gdg.data.grasps import GraspSet
from gdg.errors import GdgError
from gdg.hands.hand import find_hand
from gdg.kinds.distance import Distance
from gdg.kinds.hand_model import HandModel
from gdg.kinds.trainable import Trainable
from gdg.objects.model import ObjectModel, find_object
from gdg.registry import get_registry
from gdg.rotations import random_rotations

SEED = torch.Generator().manual_seed(0)


@pytest.fixture(scope="module")
def hand() -> HandModel:
    record = get_registry().find("hand-model", "pytorch-kinematics")
    return record.load()(record.options(), find_hand("barrett"), torch.device("cpu"))


@pytest.fixture(scope="module")
def distance() -> Distance:
    record = get_registry().find("distance", "aligned")
    return record.load()(record.options())


@pytest.fixture(scope="module")
def obj() -> ObjectModel:
    return find_object("cube_small")


@pytest.fixture(scope="module")
def grasps(hand: HandModel) -> GraspSet:
    poses = torch.eye(4).repeat(3, 1, 1)
    poses[:, :3, :3] = random_rotations(3, torch.Generator().manual_seed(0))
    poses[:, :3, 3] = -0.08 * poses[:, :3, 2]
    return GraspSet(
        hand="barrett",
        object_name="cube_small",
        joint_names=hand.joint_names,
        root_link="palm",
        poses=poses,
        joints=torch.linspace(0.2, 1.2, 3)[:, None].expand(-1, len(hand.joint_names)).contiguous(),
    )


def oracle(grasps: GraspSet, distance: Distance, folder: Path) -> OracleGenerator:
    grasps.save(folder / "grasps.json")
    options = OracleOptions(grasps=str(folder / "grasps.json"))
    return OracleGenerator(options, distance=distance)


def test_oracle_gives_the_maps_of_the_grasps_in_turn(
    hand: HandModel, obj: ObjectModel, grasps: GraspSet, distance: Distance, tmp_path: Path
) -> None:
    maps = oracle(grasps, distance, tmp_path).generate(obj, 5, SEED)
    expected = contact_map_of(hand, obj, hand.q_of(grasps), distance)
    assert maps.distance == expected.distance == distance.label
    torch.testing.assert_close(maps.values, expected.values[[0, 1, 2, 0, 1]], rtol=0, atol=1e-4)
    assert maps.values.max() > 0.5
    assert oracle(grasps, distance, tmp_path).generate(obj, 2, SEED).values.shape[0] == 2


def test_joints_are_matched_by_name(
    obj: ObjectModel, grasps: GraspSet, distance: Distance, tmp_path: Path
) -> None:
    order = [2, 0, 3, 1]
    swapped = replace(
        grasps,
        joint_names=tuple(grasps.joint_names[index] for index in order),
        joints=grasps.joints[:, order],
    )
    expected = oracle(grasps, distance, tmp_path).generate(obj, 3, SEED).values
    assert torch.equal(oracle(swapped, distance, tmp_path).generate(obj, 3, SEED).values, expected)


def test_grasps_of_another_object_hand_or_link_are_refused(
    obj: ObjectModel, grasps: GraspSet, distance: Distance, tmp_path: Path
) -> None:
    for changed, message in (
        (replace(grasps, object_name="mug"), "grasps of 'mug', not of 'cube_small'"),
        (replace(grasps, joint_names=("a", "b", "c", "d")), "have the joints a, b, c, d"),
        (replace(grasps, root_link="wrist"), "pose of link 'wrist'"),
        (grasps.select([]), "holds no grasps"),
    ):
        with pytest.raises(GdgError, match=message):
            oracle(changed, distance, tmp_path).generate(obj, 1, SEED)


def test_oracle_has_nothing_to_train() -> None:
    assert not issubclass(OracleGenerator, Trainable)
