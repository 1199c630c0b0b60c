"""Joint vectors without names get the right ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pytorch_kinematics
from real_hands import HANDS

from gdg.data.layouts.chain import actuated_values, chain_joints, chain_values
from gdg.data.layouts.foreign import ForeignGrasps
from gdg.data.layouts.pose_vectors import KNOWN_HANDS
from gdg.errors import GdgError
from gdg.hands.hand import Hand, find_hand, load_hand


def read(joints: np.ndarray, names: tuple[str, ...] | None = None) -> ForeignGrasps:
    poses = np.tile(np.eye(4), (len(joints), 1, 1))
    return ForeignGrasps("file.pt", "hand", "mug", poses, joints, names)


@pytest.mark.parametrize("name", HANDS)
def test_order_of_the_real_hands_is_that_of_pytorch_kinematics(real_hands: Path, name: str) -> None:
    hand = load_hand(real_hands / name)
    text = (real_hands / name / f"{name}.urdf").read_bytes()
    chain = pytorch_kinematics.build_chain_from_urdf(text)
    assert list(chain_joints(hand)) == chain.get_joint_parameter_names()


@pytest.mark.parametrize("name", HANDS)
def test_known_hands_are_the_real_ones(real_hands: Path, name: str) -> None:
    hand = load_hand(real_hands / name)
    assert KNOWN_HANDS[name].joints == chain_joints(hand)
    assert KNOWN_HANDS[name].root_link == hand.spec.root_link


@pytest.mark.parametrize("name", [*HANDS, "allegro_right"])
def test_vectors_of_bundled_hands_give_their_joints_back(name: str) -> None:
    hand = find_hand(name)
    joints = np.random.default_rng(0).uniform(size=(4, len(hand.spec.joints)))
    stored = chain_values(hand, joints)
    assert stored.shape == (4, len(hand.moving_joints))
    for names in (None, chain_joints(hand)):
        values, strays = actuated_values(hand, read(stored, names))
        np.testing.assert_allclose(values, joints, atol=1e-12)
        assert strays < 1e-12


def test_joints_without_their_mimics_are_taken_too(gripper: Hand) -> None:
    values, strays = actuated_values(gripper, read(np.array([[0.01], [0.02]])))
    assert values.tolist() == [[0.01], [0.02]]
    assert strays == 0.0


def test_a_mimic_joint_that_strays_is_measured(gripper: Hand) -> None:
    values, strays = actuated_values(gripper, read(np.array([[0.01, 0.015], [0.02, 0.02]])))
    assert values.tolist() == [[0.01], [0.02]]
    assert strays == pytest.approx(0.005)


def test_names_may_stand_in_any_order_with_a_prefix(gripper: Hand) -> None:
    names = ("robot0:close_right", "robot0:close")
    values, _ = actuated_values(gripper, read(np.array([[0.01, 0.02]]), names))
    assert values.tolist() == [[0.02]]


def test_another_number_of_joints_is_told_with_the_joints(gripper: Hand) -> None:
    with pytest.raises(
        GdgError, match=r"file.pt: 3 joint values.*has 2 joints, 1 without mimic"
    ) as e:
        actuated_values(gripper, read(np.zeros((1, 3))))
    assert "close, close_right" in str(e.value)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("open",), "lacks close and has open besides"),
        (("close", "other"), "has other besides"),
        (("close", "a:close"), "names a joint twice"),
    ],
)
def test_joints_of_another_hand_are_told(gripper: Hand, names: tuple[str, ...], words: str) -> None:
    with pytest.raises(GdgError, match=words):
        actuated_values(gripper, read(np.zeros((1, len(names))), names))
