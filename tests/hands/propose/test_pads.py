"""With postures that close a made-up hand, every link that closing moves has regions inside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hard_hands import HARD_HANDS, HardHand, scramble, write_hard_hand
from kinematics import link_poses
from proposals import degrees_between, draft_model, normal_of

from gdg.hands.propose.linkages import without_linkages
from gdg.hands.propose.pads import find_regions
from gdg.hands.propose.palm import PalmFace
from gdg.hands.propose.regions import Corners
from gdg.hands.propose.structure import Structure, find_structure
from gdg.kinds.hand_model import HandModel

#: How far the hands are opened and closed, as a share of each joint's way.
OPEN, CLOSED = 0.1, 0.6


def postures(hand: HardHand, model: HandModel) -> tuple[np.ndarray, np.ndarray]:
    """An open and a closed posture by the truth; joints without part in closing at zero."""
    opened, closed = [], []
    for name in model.joint_names:
        joint, sign = model.hand.urdf.joints[name], hand.closing.get(name, 0)
        # continuous joints would turn right round
        start, end = np.clip((joint.lower, joint.upper)[:: sign or 1], -1.6, 1.6)
        opened.append(start + OPEN * (end - start) if sign else np.clip(0, start, end))
        closed.append(start + CLOSED * (end - start) if sign else opened[-1])
    return np.array(opened), np.array(closed)


def palm_face(hand: HardHand, model: HandModel) -> PalmFace:
    """The truth about the palm, in its link's frame."""
    link = hand.palm_links[0]
    T_palm_root = np.linalg.inv(link_poses(model.hand.urdf, {})[link])
    normal = T_palm_root[:3, :3] @ hand.palm_normal
    center = T_palm_root[:3, :3] @ hand.palm_center + T_palm_root[:3, 3]
    return PalmFace(normal, center, 1.0, "told", link, normal)


def regions(hand: HardHand, folder: Path) -> tuple[Structure, dict[str, list[Corners]]]:
    model = draft_model(write_hard_hand(hand, folder), hand.palm_links[0])
    structure = without_linkages(model, find_structure(model.hand.urdf, model.hand.parts))
    return structure, find_regions(model, structure, palm_face(hand, model), *postures(hand, model))


@pytest.mark.parametrize("seed", [None, 0])
@pytest.mark.parametrize("name", HARD_HANDS)
def test_every_pad_has_regions_that_look_inward(name: str, seed: int | None, tmp_path: Path):
    hand = HARD_HANDS[name]() if seed is None else scramble(HARD_HANDS[name](), seed)
    structure, found = regions(hand, tmp_path)
    moving = {link for finger in structure.fingers for link in finger.links}
    for link in moving & set(hand.pads):
        for corners in found.get(link, []):
            assert degrees_between(normal_of(corners), hand.pads[link]) < 60, link
    assert {link for link in hand.distal_links if link in moving} <= set(found)


@pytest.mark.parametrize("name", ["right_hand", "three_symmetric", "jaws_mimic", "bare_roots"])
def test_the_palm_has_regions_that_look_where_it_looks(name: str, tmp_path: Path):
    hand = HARD_HANDS[name]()
    _, found = regions(hand, tmp_path)
    T_root_palm = link_poses(draft_model(tmp_path / f"{name}.urdf").hand.urdf, {})
    palm = hand.palm_links[0]
    for corners in found[palm]:
        normal = T_root_palm[palm][:3, :3] @ normal_of(corners)
        assert degrees_between(normal, hand.palm_normal) < 5


def test_links_that_closing_leaves_alone_have_none(tmp_path: Path):
    _, found = regions(HARD_HANDS["forearm"](), tmp_path)
    assert not {"forearm", "wrist", "thumb_base"} & set(found)
    assert not [link for link in found if link.endswith("knuckle")]
