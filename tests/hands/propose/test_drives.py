"""Force limits come from efforts that a hand can have, else from its size."""

from __future__ import annotations

from pathlib import Path

import pytest
from descriptions import INERTIAL, box, finger, joint, link, robot, write
from hypothesis import given
from hypothesis import strategies as st
from proposals import draft_model

from gdg.hands.propose.drives import (
    DAMPING_TIME_S,
    FINGER_FORCE_N,
    FULL_FORCE_AT,
    LEAST_TORQUE,
    PLAUSIBLE_FORCE_N,
    drive_of,
    lever,
    plausible,
)
from gdg.hands.spec import Drive
from gdg.kinds.hand_model import HandModel

#: From the tip's hinge to an edge of its box, metres.
TIP_LEVER_M = (0.01**2 + 0.025**2) ** 0.5


def limit(effort: str) -> str:
    return f'<limit lower="-0.5" upper="0.5" {effort}/>'


def model(folder: Path, effort: str = "", kind: str = "revolute") -> HandModel:
    return draft_model(write(folder, finger(limit(effort), kind=kind)))


def drive(hand: HandModel, name: str = "j2") -> tuple[Drive, bool]:
    return drive_of(hand, hand.hand.urdf.joints[name])


def test_the_lever_is_that_of_the_farthest_point(tmp_path: Path):
    hand = model(tmp_path)
    joints = hand.hand.urdf.joints
    assert lever(hand, joints["j2"]) == pytest.approx(TIP_LEVER_M, rel=0.03)
    # the tip's box reaches 75 mm beyond the first hinge
    assert lever(hand, joints["j1"]) == pytest.approx((0.01**2 + 0.075**2) ** 0.5, rel=0.25)


@pytest.mark.parametrize("torque", [0.1, 0.5, 1.2, 2.0])
def test_a_plausible_effort_is_taken(tmp_path: Path, torque: float):
    found, stated = drive(model(tmp_path, f'effort="{torque}"'))
    assert stated
    assert found.force_limit == pytest.approx(torque)


@pytest.mark.parametrize("effort", ["", 'effort="0"', 'effort="1000"', 'effort="0.001"'])
def test_a_placeholder_is_replaced_by_an_estimate(tmp_path: Path, effort: str):
    found, stated = drive(model(tmp_path, effort))
    assert not stated
    assert found.force_limit == pytest.approx(FINGER_FORCE_N * TIP_LEVER_M, rel=0.1)


def test_the_least_estimate_moves_a_finger_at_all(tmp_path: Path):
    tiny = box(size="0.004 0.004 0.006")
    hand = draft_model(write(tmp_path, finger(limit(""), tip=tiny)))
    assert drive(hand)[0].force_limit == pytest.approx(LEAST_TORQUE)


@pytest.mark.parametrize(("force", "stated"), [(20.0, True), (1000.0, False), (0.1, False)])
def test_efforts_of_sliding_joints_are_forces(tmp_path: Path, force: float, stated: bool):
    found, told = drive(model(tmp_path, f'effort="{force}"', "prismatic"))
    assert told == stated
    assert found.force_limit == pytest.approx(force if stated else FINGER_FORCE_N)
    assert found.stiffness == pytest.approx(found.force_limit / FULL_FORCE_AT["sliding"], rel=0.1)


def test_gains_give_the_whole_force_at_a_small_error(tmp_path: Path):
    found, _ = drive(model(tmp_path, 'effort="0.7"'))
    assert found.stiffness == pytest.approx(found.force_limit / FULL_FORCE_AT["turning"], rel=0.1)
    assert found.damping == pytest.approx(found.stiffness * DAMPING_TIME_S, rel=0.1)


def test_a_joint_that_moves_no_shape_still_gets_a_drive(tmp_path: Path):
    text = robot(
        link("palm", box(), INERTIAL),
        link("finger", box(), INERTIAL),
        link("frame", INERTIAL),
        joint("j1", "palm", "finger"),
        joint("j2", "finger", "frame", limit('effort="3"')),
    )
    found, stated = drive(draft_model(write(tmp_path, text)))
    assert not stated
    assert found.force_limit == pytest.approx(LEAST_TORQUE)


@pytest.fixture(scope="module")
def turning(tmp_path_factory: pytest.TempPathFactory) -> HandModel:
    return model(tmp_path_factory.mktemp("drives"))


@given(effort=st.floats(0, 1e6))
def test_plausible_efforts_give_forces_that_a_finger_can_have(turning: HandModel, effort: float):
    force = effort / lever(turning, turning.hand.urdf.joints["j2"])
    low, high = PLAUSIBLE_FORCE_N
    assert plausible(turning, "j2", effort) == (low <= force <= high)
