"""Every mistake in a hand folder is caught: each check has a copy of a good hand that breaks it."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml
from gripper import write_gripper

from gdg.errors import GdgErrors
from gdg.geometry.overlap import ConvexBody, body_of, penetration_depth
from gdg.testing import assert_hand, check_hand, inspect_hand

ROOT = Path(__file__).resolve().parents[2]

Change = Callable[[dict[str, Any]], None]


@pytest.fixture
def barrett(tmp_path: Path) -> Path:
    """A copy of a good hand."""
    folder = tmp_path / "barrett"
    shutil.copytree(ROOT / "hands" / "barrett", folder)
    return folder


def rewrite(folder: Path, change: Change) -> None:
    manifest = yaml.safe_load((folder / "hand.yaml").read_text())
    change(manifest)
    (folder / "hand.yaml").write_text(yaml.safe_dump(manifest))


def texts_of(folder: Path, severity: str) -> list[str]:
    return [str(found) for found in inspect_hand(folder) if found.severity == severity]


def add_fixed_link(folder: Path, name: str, parent: str, child: str, origin: str = "") -> None:
    """Adds a link without shapes to the URDF, and a fixed joint from ``parent`` to ``child``."""
    replace_in_urdf(folder, "</robot>", (
        f'<link name="{name}"/><joint name="to_{name}" type="fixed"><parent link="{parent}"/>'
        f'<child link="{child}"/>{origin}</joint></robot>'
    ))  # fmt: skip


def replace_in_manifest(folder: Path, old: str, new: str) -> None:
    text = (folder / "hand.yaml").read_text()
    assert old in text
    (folder / "hand.yaml").write_text(text.replace(old, new))


def replace_in_urdf(folder: Path, old: str, new: str, count: int = 1) -> None:
    """Replaces what a regular expression matches in the folder's URDF."""
    (path,) = folder.glob("*.urdf")
    text, done = re.subn(old, new, path.read_text(), count=count, flags=re.DOTALL)
    assert done
    path.write_text(text)


# -- manifests -----------------------------------------------------------------------------------


def flip_a_region(manifest: dict[str, Any]) -> None:
    manifest["contact_regions"]["finger_1_distal"][1].reverse()


def shift_a_region(manifest: dict[str, Any]) -> None:
    for corner in manifest["contact_regions"]["finger_1_distal"][1]:
        corner[1] += 0.003


def shrink_a_region(manifest: dict[str, Any]) -> None:
    first, *others = manifest["contact_regions"]["palm"][0]
    for corner in others:
        corner[:] = [a + 0.01 * (b - a) for a, b in zip(first, corner)]


def invert_the_palm(manifest: dict[str, Any]) -> None:
    manifest["palm"]["normal"] = [0, 0, -1]


def move_the_palm(manifest: dict[str, Any]) -> None:
    manifest["palm"]["center"] = [0.1, 0, 0.06]


def close_as_open(manifest: dict[str, Any]) -> None:
    manifest["closed"] = dict(manifest["open"])


def forget_the_licence(manifest: dict[str, Any]) -> None:
    manifest["provenance"]["licence"] = " "


def forget_the_source(manifest: dict[str, Any]) -> None:
    manifest["provenance"]["source"] = ""


def open_too_far(manifest: dict[str, Any]) -> None:
    manifest["open"]["spread"] = 9.0


def rename(manifest: dict[str, Any]) -> None:
    manifest["name"] = "barret"


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (flip_a_region, r"contact_regions.finger_1_distal\[1\]: faces into the link"),
        (shift_a_region, r"contact_regions.finger_1_distal\[1\]: lies up to 2.3 mm off"),
        (shrink_a_region, r"contact_regions.palm\[0\]: has only .* mm²"),
        (invert_the_palm, "palm.normal: must point out of the palm"),
        (move_the_palm, "palm.center: lies .* mm off"),
        (close_as_open, "open and closed are the same posture"),
        (forget_the_licence, "provenance.licence: is empty"),
        (forget_the_source, "provenance.source: is empty"),
        (open_too_far, "open.spread: 9 is outside the joint's limits"),
        (rename, "name: is 'barret', but the folder is called 'barrett'"),
    ],
)
def test_a_spoilt_manifest_is_an_error(change: Change, problem: str, barrett: Path):
    rewrite(barrett, change)
    assert len(check_hand(barrett)) == 1
    with pytest.raises(GdgErrors, match=problem):
        assert_hand(barrett)


def test_a_closed_posture_in_which_links_pass_through_each_other_is_an_error(tmp_path: Path):
    folder = write_gripper(tmp_path)
    replace_in_urdf(folder, 'upper="0.05"', 'upper="0.055"', count=2)
    rewrite(folder, lambda manifest: manifest["closed"].update(close=0.055))
    (problem,) = check_hand(folder)
    assert "hand.yaml: closed: 'left' and 'right' lie 10.0 mm in each other" in problem
    rewrite(folder, lambda manifest: manifest.update(allowed_self_contacts=[["left", "right"]]))
    assert_hand(folder)


def test_closed_fingertips_may_touch(tmp_path: Path):
    folder = write_gripper(tmp_path)
    replace_in_urdf(folder, 'upper="0.05"', 'upper="0.051"', count=2)
    rewrite(folder, lambda manifest: manifest["closed"].update(close=0.051))
    assert_hand(folder)


def forget_the_title(manifest: dict[str, Any]) -> None:
    del manifest["title"]


def know_no_licence(manifest: dict[str, Any]) -> None:
    manifest["provenance"]["licence"] = "unknown"


def forget_the_drives(manifest: dict[str, Any]) -> None:
    drive = manifest["drives"].pop("default")
    manifest["drives"]["joints"] = {
        joint: dict(drive) for joint in manifest["joints"] if joint != "spread"
    }


def leave_a_fingertip_bare(manifest: dict[str, Any]) -> None:
    del manifest["contact_regions"]["finger_2_distal"]


def know_no_contact(manifest: dict[str, Any]) -> None:
    manifest["contact_regions"] = {}


def leave_a_joint_out(manifest: dict[str, Any]) -> None:
    manifest["joints"].remove("finger_3_proximal")
    for posture in ("open", "closed"):
        del manifest[posture]["finger_3_proximal"]


@pytest.mark.parametrize(
    ("change", "doubt"),
    [
        (forget_the_title, "title: is empty"),
        (know_no_licence, "provenance.licence: is 'unknown'"),
        (forget_the_drives, r"drives.joints.spread: no drive is given.* 10 N m \(the URDF"),
        (leave_a_fingertip_bare, "contact_regions: none on 'finger_2_distal'"),
        (know_no_contact, "contact_regions: there is none"),
        (leave_a_joint_out, "joints: 'finger_3_proximal' can move but is not listed"),
    ],
)
def test_what_is_doubtful_in_a_manifest_is_a_warning(change: Change, doubt: str, barrett: Path):
    rewrite(barrett, change)
    (finding,) = inspect_hand(barrett)
    assert finding.severity == "warning"
    assert re.search(doubt, str(finding))
    assert_hand(barrett)


# -- URDFs ---------------------------------------------------------------------------------------

INERTIAL = r'(<link name="finger_1_proximal">\s*<inertial>.*?)'
INERTIA = INERTIAL + r"<inertia [^>]*/>"
JOINT = r'(<joint name="finger_1_proximal".*?<limit lower=")[^"]*(" upper=")[^"]*'


def inertia(xx: float, yy: float, zz: float) -> str:
    return rf'\1<inertia ixx="{xx}" ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/>'


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (INERTIA, inertia(1e-5, 1e-5, 5e-5), "finger_1_proximal': the principal moments .* of no"),
        (INERTIA, inertia(1e-5, -1e-5, 1e-5), "finger_1_proximal': .* must all be positive"),
        (INERTIAL + r'<mass value="[^"]*"', r'\1<mass value="0"', "without a mass"),
        (INERTIAL + r'<mass value="[^"]*"', r'\1<mass value="-1"', "mass -1 is negative"),
        (JOINT, r"\g<1>0\g<2>140", r"\[0, 140\] rad seem to be in degrees"),
        (JOINT, r"\g<1>3\g<2>1", "lower limit 3 is above the upper limit 1"),
    ],
)
def test_an_impossible_figure_in_a_urdf_is_an_error(
    old: str, new: str, problem: str, barrett: Path
):
    replace_in_urdf(barrett, old, new)
    problems = check_hand(barrett)
    assert any(re.search(problem, text) for text in problems), problems


@pytest.mark.parametrize(
    ("old", "new", "doubt"),
    [
        (INERTIAL + "</inertial>", r'\1</inertial>', ""),
        (INERTIA, inertia(1, 1, 1), "'finger_1_proximal': the principal moments 1, 1, 1 .* box"),
        (INERTIAL + r'<mass value="[^"]*"', r'\1<mass value="5"', "_1_proximal': a mass of 5 kg"),
        (INERTIAL + r"<origin [^>]*/>", r'\1<origin xyz="0 0 0.5"/>', "centre of mass lies .* mm"),
        (
            r'(<link name="finger_1_proximal">\s*)<inertial>.*?</inertial>', r"\1",
            "link 'finger_1_proximal': no mass is given",
        ),
        (JOINT, r"\g<1>0\g<2>7", r"\[0, 7\] rad are unusually wide"),
        (
            r'(<joint name="finger_1_distal".*?<limit lower="0" upper=")[^"]*', r"\g<1>0.5",
            "'finger_1_distal': follows 'finger_1_proximal' over .*, beyond its own limits",
        ),
    ],
)  # fmt: skip
def test_a_doubtful_figure_in_a_urdf_is_a_warning(old: str, new: str, doubt: str, barrett: Path):
    replace_in_urdf(barrett, old, new)
    warnings = [str(found) for found in inspect_hand(barrett) if found.severity == "warning"]
    if doubt:
        assert any(re.search(doubt, text) for text in warnings), warnings
    else:
        assert warnings == []


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        # puts the left jaw into the right one
        ('<origin xyz="0 0.05 0"/>', '<origin xyz="0 -0.058 0"/>', "'left' and 'right' lie"),
        ('<child link="left"/>', '<child link="nothing"/>', "'nothing' does not exist"),
        ('<axis xyz="0 -1 0"/>', '<axis xyz="0 0 0"/>', "axis"),
    ],
)
def test_a_spoilt_urdf_is_an_error(old: str, new: str, problem: str, tmp_path: Path):
    folder = write_gripper(tmp_path)
    replace_in_urdf(folder, re.escape(old), new)
    assert any(problem in text for text in check_hand(folder))


def test_a_joint_that_moves_nothing_is_an_error(tmp_path: Path):
    folder = write_gripper(tmp_path)
    manifest = folder / "hand.yaml"
    idle = (
        '<link name="idle"/><joint name="idle" type="revolute"><parent link="palm"/>'
        '<child link="idle"/><axis xyz="0 0 1"/><limit lower="0" upper="1"/></joint></robot>'
    )
    replace_in_urdf(folder, "</robot>", idle)
    manifest.write_text(manifest.read_text().replace("[close]", "[close, idle]"))
    assert check_hand(folder) == [
        f"{manifest}: joints: joint 'idle' moves no surface of the hand; leave it out."
    ]


def test_a_joint_that_turns_right_round_is_none(tmp_path: Path):
    folder = write_gripper(tmp_path)
    wheel = (
        '<link name="wheel"><collision><origin xyz="0.03 0 0.1"/><geometry>'
        '<box size="0.02 0.02 0.02"/></geometry></collision></link><joint name="turn" '
        'type="continuous"><parent link="palm"/><child link="wheel"/><axis xyz="0 0 1"/></joint>'
        "</robot>"
    )
    replace_in_urdf(folder, "</robot>", wheel)
    rewrite(folder, lambda manifest: manifest.update(joints=["close", "turn"]))
    assert not any("'turn'" in text for text in check_hand(folder))


def test_a_hand_in_another_unit_is_an_error(tmp_path: Path):
    folder = write_gripper(tmp_path)
    path = folder / "two_jaws.urdf"

    def shrink(found: re.Match[str]) -> str:
        numbers = " ".join(f"{float(word) / 100:g}" for word in found[2].split())
        return f'{found[1]}="{numbers}"'

    path.write_text(re.sub('(size|origin xyz|upper)="([^"]*)"', shrink, path.read_text()))
    rewrite(folder, lambda manifest: manifest["closed"].update(close=0.0005))
    assert any("m long: its lengths seem to be in another unit" in t for t in check_hand(folder))


def test_limits_that_leave_no_range_are_an_error(tmp_path: Path):
    folder = write_gripper(tmp_path)
    replace_in_urdf(folder, 'upper="0.05"', 'upper="0"')
    rewrite(folder, lambda manifest: manifest["closed"].update(close=0.0))
    wanted = "joint 'close': the lower limit 0 must be below the upper one 0"
    assert any(wanted in text for text in check_hand(folder))


def test_a_link_that_floats_away_is_a_warning(tmp_path: Path):
    folder = write_gripper(tmp_path)
    replace_in_urdf(folder, re.escape('<origin xyz="0 0.005 0.035"/>'), '<origin xyz="0 0 0.2"/>')
    warnings = texts_of(folder, "warning")
    assert any("the shapes of 'left' lie 170 mm off those of 'palm'" in text for text in warnings)


def test_a_root_frame_far_away_is_a_warning(tmp_path: Path):
    folder = write_gripper(tmp_path)
    add_fixed_link(folder, "room", "room", "base", '<origin xyz="2 0 0"/>')
    replace_in_manifest(folder, "root_link: base", "root_link: room")
    warnings = texts_of(folder, "warning")
    assert any("root_link: the frame of 'room' lies 1980 mm off" in text for text in warnings)


def test_a_region_on_a_link_without_shapes_is_an_error(tmp_path: Path):
    folder = write_gripper(tmp_path)
    add_fixed_link(folder, "mark", "left", "mark")
    replace_in_manifest(folder, "  left:\n", "  mark:\n")
    assert any("contact_regions.mark: the link has no" in text for text in check_hand(folder))


# -- folders -------------------------------------------------------------------------------------


def test_a_folder_without_a_manifest_is_an_error(tmp_path: Path):
    (problem,) = check_hand(tmp_path)
    assert "hand.yaml" in problem


def test_mistakes_in_manifest_and_urdf_are_told_together(tmp_path: Path):
    folder = write_gripper(tmp_path)
    replace_in_urdf(folder, re.escape('<axis xyz="0 -1 0"/>'), '<axis xyz="0 0 0"/>')
    replace_in_manifest(folder, "joints:", "jionts:")
    problems = check_hand(folder)
    assert any("jionts" in text for text in problems)
    assert any("two_jaws.urdf: joint 'close': its axis must not be zero" in t for t in problems)


def lift_a_region(manifest: dict[str, Any]) -> None:
    for corner in manifest["contact_regions"]["finger_1_distal"][1]:
        corner[1] += 0.03


def delete_the_licence(manifest: dict[str, Any]) -> None:
    del manifest["provenance"]["licence"]


def make_a_spring_negative(manifest: dict[str, Any]) -> None:
    manifest["drives"]["default"]["stiffness"] = -1


def mistype_the_root(manifest: dict[str, Any]) -> None:
    manifest["root_link"] = "plam"


def mistype_an_open_joint(manifest: dict[str, Any]) -> None:
    manifest["open"]["spreed"] = manifest["open"].pop("spread")


def mistype_a_joint(manifest: dict[str, Any]) -> None:
    manifest["joints"][0] = "spreed"


def mistype_a_touching_link(manifest: dict[str, Any]) -> None:
    manifest["contact_regions"]["finger_2_dital"] = manifest["contact_regions"].pop(
        "finger_2_distal"
    )


def mistype_a_section(manifest: dict[str, Any]) -> None:
    manifest["clsoed"] = manifest.pop("closed")


def flatten_a_region(manifest: dict[str, Any]) -> None:
    manifest["contact_regions"]["finger_1_distal"][0] = [[0, 0, 0] for _ in range(4)]


def lengthen_the_normal(manifest: dict[str, Any]) -> None:
    manifest["palm"]["normal"] = [0, 0, 2]


LIFTED = "contact_regions.finger_1_distal[1]: lies up to"
TURNED = "palm.normal: must point out of the palm"


@pytest.mark.parametrize(
    ("changes", "problems"),
    [
        (
            (delete_the_licence, make_a_spring_negative, lift_a_region, invert_the_palm),
            ["drives.default.stiffness", "provenance.licence: must be given", LIFTED, TURNED],
        ),
        (
            (mistype_the_root, mistype_an_open_joint, mistype_a_touching_link, lift_a_region),
            [
                "root_link: link 'plam'", "contact_regions.finger_2_dital: link",
                "open.spreed: joint", LIFTED,
            ],
        ),
        (
            (delete_the_licence, mistype_the_root, forget_the_source, move_the_palm),
            ["licence: must", "root_link: link 'plam'", "source: is empty", "palm.center: lies"],
        ),
        (
            (flatten_a_region, mistype_a_joint, lift_a_region, rename),
            [
                "finger_1_distal.0: the corners span no", "joints[0]: joint 'spreed'",
                LIFTED, "name: is 'barret'",
            ],
        ),
        (
            (mistype_a_section, lengthen_the_normal, forget_the_title, open_too_far, lift_a_region),
            ["clsoed: there is no", "palm.normal: must be a unit", "open.spread: 9 is", LIFTED],
        ),
    ],
)  # fmt: skip
def test_what_is_refused_hides_no_other_mistake(
    changes: tuple[Change, ...], problems: list[str], barrett: Path
):
    for change in changes:
        rewrite(barrett, change)
    told = check_hand(barrett)
    assert [sum(problem in text for text in told) for problem in problems] == [1] * len(problems)
    assert len(told) == len(problems), told


def test_a_lost_mesh_is_told_beside_a_refused_manifest(tmp_path: Path):
    folder = write_gripper(tmp_path)
    replace_in_urdf(folder, r"<box [^>]*/>", '<mesh filename="one.stl"/>')
    rewrite(folder, lambda manifest: manifest.update(provenance={}))
    assert ["one.stl" in text for text in check_hand(folder)].count(True) == 1


@pytest.mark.parametrize("section", [
    "name", "title", "urdf", "geometry", "root_link", "palm", "joints", "open", "closed",
    "contact_regions", "allowed_self_contacts", "drives", "provenance",
])  # fmt: skip
def test_mending_a_section_causes_no_finding(section: str, barrett: Path):
    rewrite(barrett, lambda manifest: manifest.update({section: 5}))
    assert all(f"hand.yaml: {section}" in str(finding) for finding in inspect_hand(barrett))
    assert inspect_hand(barrett)
    rewrite(barrett, lambda manifest: manifest.update({section: {"nonsense": [{}]}}))
    assert all(f"hand.yaml: {section}" in str(finding) for finding in inspect_hand(barrett))


def test_all_lost_meshes_are_told_together(tmp_path: Path):
    folder = write_gripper(tmp_path)
    for name in ("one", "two"):
        replace_in_urdf(folder, r"<box [^>]*/>", f'<mesh filename="{name}.stl"/>')
    problems = check_hand(folder)
    assert [name for name in ("one.stl", "two.stl") if any(name in t for t in problems)] == [
        "one.stl", "two.stl"
    ]  # fmt: skip


def test_errors_come_before_warnings(barrett: Path):
    rewrite(barrett, forget_the_title)
    rewrite(barrett, invert_the_palm)
    assert [found.severity for found in inspect_hand(barrett)] == ["error", "warning"]


# -- depth of convex bodies in each other --------------------------------------------------------


def box(*size: float) -> ConvexBody:
    return body_of(trimesh.creation.box(size))


def ball(radius: float) -> ConvexBody:
    return ConvexBody(np.zeros((1, 3)), np.zeros((0, 3)), radius)


def shifted(body: ConvexBody, *shift: float) -> ConvexBody:
    return body.placed(trimesh.transformations.translation_matrix(shift))


@pytest.mark.parametrize(
    ("a", "b", "depth"),
    [
        (box(1, 1, 1), shifted(box(1, 1, 1), 0.9, 0.2, 0), 0.1),
        (box(1, 1, 1), shifted(box(1, 1, 1), 1.1, 0, 0), 0.0),
        (box(1, 1, 1), box(0.2, 0.2, 0.2), 0.6),
        (ball(0.5), shifted(ball(0.5), 0.9, 0, 0), 0.1),
        (ball(0.5), shifted(ball(0.5), 1.1, 0, 0), 0.0),
        (box(1, 1, 1), shifted(ball(0.5), 0.9, 0, 0), 0.1),
        # beside an edge, where no face separates them
        (box(1, 1, 1), shifted(ball(0.5), 0.8, 0.8, 0), 0.5 - math.hypot(0.3, 0.3)),
        (box(1, 1, 1), shifted(ball(0.5), 0.9, 0.9, 0), 0.0),
    ],
)
def test_depth_of_bodies_that_can_be_worked_out_by_hand(a: ConvexBody, b: ConvexBody, depth: float):
    assert penetration_depth(a, b) == pytest.approx(depth, abs=1e-9)
    assert penetration_depth(b, a) == pytest.approx(depth, abs=1e-9)


def test_depth_is_the_least_overlap_over_all_directions():
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(100_000, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    for _ in range(6):
        a, b = (trimesh.convex.convex_hull(rng.normal(size=(20, 3))) for _ in range(2))
        body = body_of(b).placed(trimesh.transformations.translation_matrix(rng.normal(size=3)))
        on_a, on_b = a.vertices @ directions.T, body.points @ directions.T
        sampled = max(0.0, float((on_a.max(0) - on_b.min(0)).min()))
        depth = penetration_depth(body_of(a), body)
        assert depth <= sampled + 1e-9
        assert depth == pytest.approx(sampled, abs=0.03)


def test_depths_up_to_the_ignored_one_are_not_worked_out():
    near = shifted(box(1, 1, 1), 0.95, 0, 0)
    assert penetration_depth(box(1, 1, 1), near, ignored=0.06) == 0.0
    assert penetration_depth(box(1, 1, 1), near, ignored=0.04) == pytest.approx(0.05)
