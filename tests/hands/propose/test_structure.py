"""Palm, fingers and wrist are read from the tree and the shapes."""

from __future__ import annotations

from pathlib import Path

import pytest
from descriptions import INERTIAL, LIMIT, box, finger, joint, link, robot, write
from hard_hands import HARD_HANDS, HardHand, rename, scramble, write_hard_hand

from gdg.errors import GdgError
from gdg.hands.geometry import ConvexPart, link_parts
from gdg.hands.propose.structure import LONGEST_SINGLE_FINGER, Structure, find_structure
from gdg.hands.urdf import Joint, Urdf, read_urdf

#: Fingers per made-up hand where it isn't five; the bars of a four-bar count until they are told.
FINGERS = {
    "jaws_mimic": 2, "jaws_both_driven": 2, "jaw_and_fixed_jaw": 1, "four_bar": 4,
    "outstretched": 2, "three_symmetric": 3, "three_spread_first": 3, "three_opposed": 3,
    "continuous_joints": 3, "adapter_plate": 3, "two_and_thumb": 3, "flexion_first": 4,
    "four_fingers": 4,
}  # fmt: skip


def structure_of(folder: Path, text: str) -> Structure:
    urdf = read_urdf(write(folder, text))
    return find_structure(urdf, link_parts(urdf, folder, "collision"))


def read(hand: HardHand, folder: Path) -> tuple[Urdf, tuple[ConvexPart, ...]]:
    urdf = read_urdf(write_hard_hand(hand, folder))
    shaped = any(link.collisions for link in urdf.links.values())
    return urdf, link_parts(urdf, folder, "collision" if shaped else "visual")


def chain(moving: int, *, shaped: bool = True) -> str:
    """Links one after the other, each on a moving joint."""
    links = [link(f"l{i}", box() if shaped or i == 0 else "", INERTIAL) for i in range(moving + 1)]
    return robot(*links, *(joint(f"j{i}", f"l{i}", f"l{i + 1}") for i in range(moving)))


@pytest.mark.parametrize("name", HARD_HANDS)
def test_the_palm_is_the_body_from_which_the_fingers_branch(name: str, tmp_path: Path):
    hand = HARD_HANDS[name]()
    structure = find_structure(*read(hand, tmp_path))
    assert structure.palm in hand.palm_links
    assert structure.palm in structure.palm_body
    assert len(structure.fingers) == FINGERS.get(name, 5)


@pytest.mark.parametrize("name", HARD_HANDS)
def test_every_fingertip_is_the_end_of_one_finger(name: str, tmp_path: Path):
    hand = HARD_HANDS[name]()
    structure = find_structure(*read(hand, tmp_path))
    found = [tip for one in structure.fingers for tip in one.distal]
    assert len(set(found)) == len(found)
    carriers = {j.child: j for j in hand.joints}
    bodies = {_body(carriers, tip) for tip in found}
    moving = [tip for tip in hand.distal_links if _body(carriers, tip) is not None]
    assert {_body(carriers, tip) for tip in moving} <= bodies
    for one in structure.fingers:
        assert set(one.distal) <= set(one.links)
        assert {carriers[link].name for link in one.links} >= set(one.joints)


def _body(carriers: dict[str, Joint], link: str) -> str | None:
    """The moving joint that carries a link; None for the root's body."""
    while link in carriers and carriers[link].type == "fixed":
        link = carriers[link].parent
    return carriers[link].name if link in carriers else None


@pytest.mark.parametrize("name", ["forearm", "split_palm", "four_bar", "adapter_plate"])
def test_frames_and_names_change_nothing(name: str, tmp_path: Path):
    hand = HARD_HANDS[name]()
    structure = find_structure(*read(hand, tmp_path / "plain"))
    other = rename(scramble(hand, 0), 0)
    again = find_structure(*read(other, tmp_path / "scrambled"))
    link = dict(zip(hand.links, other.links))
    assert again.palm == link[structure.palm]
    assert set(again.palm_body) == {link[name] for name in structure.palm_body}
    tips = {frozenset(link[tip] for tip in one.distal) for one in structure.fingers}
    assert {frozenset(one.distal) for one in again.fingers} == tips


def test_what_lies_between_root_and_palm_is_wrist(tmp_path: Path):
    structure = find_structure(*read(HARD_HANDS["forearm"](), tmp_path))
    assert structure.wrist == ("wrist_deviation", "wrist_flexion")
    assert structure.palm_body == ("palm",)


def test_a_mount_belongs_to_the_palms_body_but_is_not_the_palm(tmp_path: Path):
    structure = find_structure(*read(HARD_HANDS["adapter_plate"](), tmp_path))
    assert structure.palm == "palm"
    assert set(structure.palm_body) == {"plate", "coupling", "palm"}
    assert structure.wrist == ()


def test_links_without_shapes_before_the_palm_are_no_palm(tmp_path: Path):
    structure = find_structure(*read(HARD_HANDS["bare_roots"](), tmp_path))
    assert structure.palm == "palm"
    assert structure.palm_body == ("palm",)


def test_a_moving_metacarpal_is_part_of_its_finger(tmp_path: Path):
    structure = find_structure(*read(HARD_HANDS["split_palm"](), tmp_path))
    (little,) = [one for one in structure.fingers if "palm_fold" in one.joints]
    assert little.joints[0] == "palm_fold"
    assert little.distal == ("little_3",)


def test_tip_frames_without_shapes_are_no_tips(tmp_path: Path):
    structure = find_structure(*read(HARD_HANDS["four_fingers"](), tmp_path))
    assert {tip for one in structure.fingers for tip in one.distal} == {
        "index_3", "middle_3", "ring_3", "thumb_2",
    }  # fmt: skip


def test_a_single_finger_stands_on_the_root(tmp_path: Path):
    structure = structure_of(tmp_path, finger())
    assert structure.palm == "palm"
    assert structure.wrist == ()
    (one,) = structure.fingers
    assert one.joints == ("j1", "j2")
    assert one.links == ("proximal", "tip")
    assert one.distal == ("tip",)


@pytest.mark.parametrize("moving", [1, LONGEST_SINGLE_FINGER, LONGEST_SINGLE_FINGER + 1, 6])
def test_a_long_chain_is_an_arm_with_a_jaw(tmp_path: Path, moving: int):
    structure = structure_of(tmp_path, chain(moving))
    arm = moving > LONGEST_SINGLE_FINGER
    assert structure.palm == (f"l{moving - 1}" if arm else "l0")
    assert structure.wrist == (tuple(f"j{i}" for i in range(moving - 1)) if arm else ())
    (one,) = structure.fingers
    assert one.joints == ((f"j{moving - 1}",) if arm else tuple(f"j{i}" for i in range(moving)))


def test_a_description_in_which_nothing_with_shapes_moves_is_refused(tmp_path: Path):
    for number, text in enumerate((chain(0), chain(2, shaped=False))):
        with pytest.raises(GdgError, match="no joint moves a link that has shapes"):
            structure_of(tmp_path / str(number), text)


def test_a_palm_without_shapes_takes_those_of_the_body_before_it(tmp_path: Path):
    names = ("left", "right")
    text = robot(
        link("arm", box(), INERTIAL),
        link("hub", INERTIAL),
        *(link(name, box(), INERTIAL) for name in names),
        joint("wrist", "arm", "hub"),
        *(joint(f"{name}_joint", "hub", name) for name in names),
    )
    structure = structure_of(tmp_path, text)
    assert structure.palm == "arm"
    assert structure.palm_body == ("arm",)
    assert structure.wrist == ("wrist",)


def test_a_bare_root_is_the_palm_where_nothing_else_can_be(tmp_path: Path):
    names = ("left", "right")
    text = robot(
        link("hub"),
        *(link(name, box(), INERTIAL) for name in names),
        *(joint(f"{name}_joint", "hub", name, LIMIT) for name in names),
    )
    structure = structure_of(tmp_path, text)
    assert structure.palm == "hub"
    assert structure.palm_body == ()
    assert len(structure.fingers) == 2
