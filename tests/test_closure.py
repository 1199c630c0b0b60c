"""Fingers close until they touch, and no further."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from conftest import build_model
from gripper import MANIFEST, OPEN_M, URDF, write_gripper
from torch import Tensor

from gdg.closure import STEPS, close_until_touch, moved_links
from gdg.hands.hand import find_hand, load_hand
from gdg.initial_poses import above_surface
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.rotations import ROOT_DIM, q_from_pose

#: Half the cube's edge, and how far the gripper's base lies below its middle, metres.
HALF_CUBE_M, BELOW_M = 0.02, 0.035
#: What one step closes, metres.
STEP_M = OPEN_M / STEPS


def around_the_cube(joints: list[list[float]], y: float = 0.0) -> Tensor:
    """The gripper around the cube's middle, moved along its closing direction, metres."""
    poses = torch.eye(4).repeat(len(joints), 1, 1)
    poses[:, 1, 3], poses[:, 2, 3] = y, -BELOW_M
    return q_from_pose(poses, torch.tensor(joints))


@pytest.fixture(scope="module")
def separate(tmp_path_factory: pytest.TempPathFactory) -> HandModel:
    """The gripper with a drive for each jaw."""
    folder = write_gripper(tmp_path_factory.mktemp("hands"))
    urdf, manifest = URDF.replace('<mimic joint="close"/>', ""), MANIFEST
    for old, new in (
        ("joints: [close]", "joints: [close, close_right]"),
        ("open: {close: 0.0}", "open: {close: 0.0, close_right: 0.0}"),
        ("closed: {close: 0.05}", "closed: {close: 0.05, close_right: 0.04}"),
    ):
        manifest = manifest.replace(old, new)
    (folder / "two_jaws.urdf").write_text(urdf)
    (folder / "hand.yaml").write_text(manifest)
    return build_model(load_hand(folder))


def test_jaws_close_on_the_cube(gripper_model: HandModel, cube: ObjectModel):
    q = close_until_touch(gripper_model, cube, around_the_cube([[0.0], [0.01], [0.0299]]))
    opening = OPEN_M - q[:, ROOT_DIM:]
    assert (opening >= HALF_CUBE_M - 1e-5).all()
    assert (opening < HALF_CUBE_M + STEP_M + 1e-5).all()
    distance = cube.sdf.distance(gripper_model.surface_points(q)).amin(1)
    assert (distance > 0).all()
    assert (distance < STEP_M + 1e-4).all()


def test_jaws_that_miss_the_object_close_all_the_way(gripper_model: HandModel, cube: ObjectModel):
    q = around_the_cube([[0.0], [0.02]])
    q[:, 0] += 0.2
    closed = close_until_touch(gripper_model, cube, q)
    torch.testing.assert_close(closed[:, ROOT_DIM:], torch.full((2, 1), 0.05), rtol=0, atol=STEP_M)


def test_the_root_stays(gripper_model: HandModel, cube: ObjectModel):
    q = around_the_cube([[0.0]], y=0.004)
    closed = close_until_touch(gripper_model, cube, q)
    assert torch.equal(closed[:, :ROOT_DIM], q[:, :ROOT_DIM])


def test_a_joint_that_moves_two_jaws_stops_when_one_touches(
    gripper_model: HandModel, cube: ObjectModel
):
    q = close_until_touch(gripper_model, cube, around_the_cube([[0.0]], y=0.006))
    # the right jaw's face is at y = 6 mm - opening, the left one's at 6 mm + opening
    assert OPEN_M - float(q[0, -1]) == pytest.approx(HALF_CUBE_M + 0.006, abs=STEP_M + 1e-4)


def test_the_other_jaw_goes_on(separate: HandModel, cube: ObjectModel):
    q = close_until_touch(separate, cube, around_the_cube([[0.0, 0.0]], y=0.006))
    openings = OPEN_M - q[0, ROOT_DIM:]
    assert float(openings[0]) == pytest.approx(HALF_CUBE_M - 0.006, abs=STEP_M + 1e-4)
    assert float(openings[1]) == pytest.approx(HALF_CUBE_M + 0.006, abs=STEP_M + 1e-4)


@pytest.mark.parametrize("value", [0.031, 0.04, 0.05])
def test_joints_that_touch_stay(gripper_model: HandModel, cube: ObjectModel, value: float):
    q = around_the_cube([[value]])
    assert torch.equal(close_until_touch(gripper_model, cube, q), q)


def test_joints_beyond_the_closed_posture_stay(separate: HandModel, cube: ObjectModel):
    q = around_the_cube([[0.0, 0.045]])
    q[:, 0] += 0.2
    closed = close_until_touch(separate, cube, q)
    assert float(closed[0, -1]) == pytest.approx(0.045)
    assert float(closed[0, -2]) == pytest.approx(0.05, abs=STEP_M)


def test_a_joint_without_part_in_closing_stays(tmp_path: Path, cube: ObjectModel):
    folder = write_gripper(tmp_path)
    text = (folder / "hand.yaml").read_text()
    (folder / "hand.yaml").write_text(text.replace("open: {close: 0.0}", "open: {close: 0.05}"))
    q = around_the_cube([[0.003], [0.0]])
    assert torch.equal(close_until_touch(build_model(load_hand(folder)), cube, q), q)


@pytest.fixture(scope="module", params=["barrett", "allegro"])
def hand(request: pytest.FixtureRequest) -> HandModel:
    return build_model(find_hand(request.param), points=400)


@pytest.fixture(scope="module")
def starts(hand: HandModel, cube: ObjectModel) -> Tensor:
    return above_surface(hand, cube, 6, torch.Generator().manual_seed(0))


def test_every_joint_lies_between_its_start_and_the_closed_posture(
    hand: HandModel, cube: ObjectModel, starts: Tensor
):
    closed = close_until_touch(hand, cube, starts)[:, ROOT_DIM:]
    start, step = starts[:, ROOT_DIM:], (hand.closed_posture - hand.open_posture) / STEPS
    assert (((closed - start) * step.sign()) >= 0).all()
    reached = (hand.closed_posture - closed) * step.sign()
    moved = closed != start
    assert moved.any()
    assert (reached[moved] >= -(step.abs() / 2 + 1e-6).expand_as(reached)[moved]).all()
    assert (closed[:, step == 0] == start[:, step == 0]).all()


def test_closing_presses_nothing_into_the_object(
    hand: HandModel, cube: ObjectModel, starts: Tensor
):
    before = cube.sdf.distance(hand.surface_points(starts)).amin(1)
    closed = close_until_touch(hand, cube, starts)
    after = cube.sdf.distance(hand.surface_points(closed)).amin(1)
    assert (after >= before.clamp(max=0) - 1e-6).all()


def test_a_batch_of_one_equals_the_batch(hand: HandModel, cube: ObjectModel, starts: Tensor):
    together = close_until_touch(hand, cube, starts)
    alone = [close_until_touch(hand, cube, q[None]) for q in starts]
    torch.testing.assert_close(torch.cat(alone), together, rtol=0, atol=1e-6)


def test_a_joint_moves_what_hangs_on_it_and_on_its_mimics(hand: HandModel):
    moves, generator = moved_links(hand), torch.Generator().manual_seed(0)
    share = torch.rand(len(hand.joint_names), generator=generator)
    joints = hand.lower + (0.2 + 0.6 * share) * (hand.upper - hand.lower)
    steps = joints + 0.01 * torch.eye(len(joints))
    change = hand.link_poses_in_root(steps) - hand.link_poses_in_root(joints[None])
    assert torch.equal(change.abs().amax((-1, -2)) > 1e-5, moves)
