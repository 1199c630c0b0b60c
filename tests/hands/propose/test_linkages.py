"""The bars of a linkage are told from fingers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hard_hands import HARD_HANDS, HardHand, scramble, write_hard_hand
from proposals import draft_model

from gdg.hands.propose.linkages import without_linkages
from gdg.hands.propose.structure import Structure, find_structure


def structures(hand: HardHand, folder: Path) -> tuple[Structure, Structure]:
    """The structure with bars and without."""
    model = draft_model(write_hard_hand(hand, folder))
    found = find_structure(model.hand.urdf, model.hand.parts)
    return found, without_linkages(model, found)


@pytest.mark.parametrize("seed", [None, 0, 1])
def test_the_bars_of_four_bars_are_left_out(tmp_path: Path, seed: int | None):
    hand = HARD_HANDS["four_bar"]()
    if seed is not None:
        hand = scramble(hand, seed)
    before, after = structures(hand, tmp_path)
    bars = {finger.links for finger in before.fingers} - {finger.links for finger in after.fingers}
    assert bars == {("left_inner_knuckle",), ("right_inner_knuckle",)}
    assert replace(after, fingers=before.fingers) == before
    assert [finger.distal for finger in after.fingers] == [
        ("left_inner_finger", "left_pad"), ("right_inner_finger", "right_pad"),
    ]  # fmt: skip


@pytest.mark.parametrize("name", [name for name in HARD_HANDS if name != "four_bar"])
def test_fingers_are_no_bars(name: str, tmp_path: Path):
    before, after = structures(HARD_HANDS[name](), tmp_path)
    assert after == before


def test_a_finger_with_a_drive_of_its_own_is_no_bar(tmp_path: Path):
    hand = HARD_HANDS["four_bar"]()
    joints = tuple(
        replace(joint, mimic=None) if "inner_knuckle" in joint.name else joint
        for joint in hand.joints
    )
    before, after = structures(replace(hand, joints=joints), tmp_path)
    assert after == before
