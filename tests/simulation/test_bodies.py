"""Joints that one motor turns share its force limit by virtual work."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from gdg_plugins.simulator_sapien.options import SapienOptions
from gripper import URDF, write_gripper
from jaws import protocol_of

from gdg.hands.hand import Hand, find_hand, load_hand
from gdg.protocols import Protocol
from gdg.simulation.bodies import joint_drive

REALISTIC = protocol_of("gdg-realistic-1")
PER_JOINT = REALISTIC.model_copy(update={"shared_motors": False})


def limits(hand: Hand, protocol: Protocol = REALISTIC) -> dict[str, float]:
    """Force limit of each moving joint, N m."""
    drives = {j.name: joint_drive(hand, j, protocol, SapienOptions()) for j in hand.moving_joints}
    return {name: drive.force_limit or np.inf for name, drive in drives.items()}


@pytest.mark.parametrize("name", ["barrett", "ezgripper", "robotiq_3finger", "shadowhand"])
def test_what_a_motors_joints_do_together_is_what_the_motor_can(name: str):
    hand = find_hand(name)
    found = limits(hand)
    for column, motor in enumerate(hand.spec.joints):
        speeds = np.abs(hand.coupling[0][:, column])
        power = sum(s * found[j.name] for s, j in zip(speeds, hand.moving_joints, strict=True))
        assert power == pytest.approx(hand.spec.drives.of(motor).force_limit)


def test_barretts_fingers_share_a_motor_between_two_joints():
    hand = find_hand("barrett")
    found = limits(hand)
    # 6 N m, the distal joint at 0.344 of the proximal one's speed; two spread joints at the same
    assert found["finger_1_proximal"] == pytest.approx(6 / 1.344262)
    assert found["finger_1_distal"] == pytest.approx(6 / 1.344262)
    assert found["spread"] == pytest.approx(3.0)
    assert set(limits(hand, PER_JOINT).values()) == {6.0}


@pytest.mark.parametrize("name", ["allegro", "shadowhand"])
def test_a_hand_of_a_motor_per_joint_is_as_strong_either_way(name: str):
    hand = find_hand(name)
    assert limits(hand) == limits(hand, PER_JOINT)


def test_a_passive_joint_keeps_the_limit_that_locks_it(tmp_path: Path):
    text = URDF.replace('    <mimic joint="close"/>\n', "")
    assert text != URDF
    folder = write_gripper(tmp_path)
    (folder / "two_jaws.urdf").write_text(text, encoding="utf-8")
    hand = load_hand(folder)
    assert limits(hand) == limits(hand, PER_JOINT) == {"close": 20.0, "close_right": 20.0}
