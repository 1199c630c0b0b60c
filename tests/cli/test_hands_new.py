"""``gdg hands new`` makes a whole hand folder from a bare description, or leaves nothing behind."""

from __future__ import annotations

import re
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import Outcome, refused
from descriptions import INERTIAL, box, finger, joint, link, robot, write
from hard_hands import jaws_mimic, urdf_text, write_hard_hand
from hard_hands.builder import Builder
from hard_hands.fingers import TWO_TO_ONE, Finger, around, disc_palm

from gdg.hands.hand import load_hand
from gdg.testing import check_hand

Run = Callable[..., Outcome]


def contents(folder: Path) -> dict[str, bytes | None]:
    """Every file and folder below, hidden ones included."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


def ros_package(folder: Path) -> Path:
    """A three-finger hand as ROS packages have it; its meshes are in millimetres, without scale."""
    builder = Builder("acme")
    disc_palm(builder)
    around(builder, Finger((0.05, 0.04), shape="mesh"), TWO_TO_ONE, 0.045)
    hand = builder.done(["palm"], (0, 0, 1), (0, 0, 0))
    package = folder / "acme_description"
    write_hard_hand(hand, package)
    text = urdf_text(hand).replace('filename="meshes/', 'filename="package://acme_description/')
    text = text.replace("acme_description/", "acme_description/meshes/").replace(
        ' scale="0.001 0.001 0.001"', ""
    )
    assert 'filename="package://acme_description/meshes/finger1_1.stl"/' in text
    (package / "acme.urdf").unlink()
    return write(package, text, "urdf/acme_hand.v2.urdf")


def jaws(text_before: str = "") -> str:
    """Parallel jaws, as URDF; something before the first link."""
    return urdf_text(jaws_mimic()).replace(">\n<link", f">{text_before}\n<link", 1)


def test_a_bare_urdf_becomes_a_hand(run: Run, tmp_path: Path):
    source = ros_package(tmp_path / "ros")
    before = contents(tmp_path / "ros")
    outcome = run("hands", "new", source)
    assert outcome.code == 0, outcome.err
    folder = Path("acme_hand")
    names = {"hand.yaml", "acme_hand.urdf", "meshes", "README.md", "report.html", "picture.png"}
    assert {path.name for path in folder.iterdir()} == names
    assert len(list((folder / "meshes").iterdir())) == 6
    assert [path.name for path in Path().iterdir() if path.name != "ros"] == ["acme_hand"]
    assert contents(tmp_path / "ros") == before
    hand = load_hand(folder)
    assert hand.spec.palm.link == "palm"
    assert set(hand.spec.joints) == {f"finger{i}_flex{j}" for i in (1, 2, 3) for j in (1, 2)}
    (part,) = {p.link: p for p in hand.parts if p.link == "finger1_2"}.values()
    assert 0.03 < part.mesh.extents.max() < 0.05
    assert check_hand(folder) == []
    for joint_name in hand.spec.joints:
        assert f"joint {joint_name}" in outcome.out
    for part_of_output in (
        "decided", "how sure", "palm.normal", "sure (", "contact_regions", "drives",
        "acme_hand: hand.yaml, acme_hand.urdf, report.html, picture.png",
        "gdg grasp hand=./acme_hand object=apple",
    ):  # fmt: skip
        assert part_of_output in outcome.out
    assert re.search(r"changed: .*millimetres", outcome.out)
    assert "Traceback" not in outcome.err
    text = (folder / "hand.yaml").read_text()
    assert re.search(r"^  # (sure|likely|look at this): .*\n  normal: ", text, re.MULTILINE)
    again = run("hands", "new", source)
    refused(again, "acme_hand: exists already")


def test_a_hand_on_an_arm_is_cut_off_with_root_into_an_empty_folder(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    arm = [link(name, box(), INERTIAL) for name in ("base", "upper_arm", "lower_arm")]
    joints = [
        joint("shoulder", "base", "upper_arm", kind="continuous", inner=""),
        joint("elbow", "upper_arm", "lower_arm"),
        joint("mount", "lower_arm", "housing", kind="fixed", inner=""),
    ]
    source = write(tmp_path, jaws("".join([*arm, *joints])), "robot.urdf")
    place = tmp_path / "my_jaws"
    place.mkdir()
    monkeypatch.chdir(place)
    outcome = run("hands", "new", source, "--root", "housing", "--out", ".")
    assert outcome.code == 0, outcome.err
    hand = load_hand(place)
    # without a name the folder gives it
    assert hand.name == "my_jaws"
    assert hand.spec.root_link == hand.urdf.root == "housing"
    assert hand.spec.joints == ("left_slide",)
    assert {path.name for path in tmp_path.iterdir()} == {"robot.urdf", "my_jaws"}
    assert not [path for path in place.iterdir() if path.name.startswith(".")]


# -- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize("hidden", [False, True])
def test_a_folder_that_holds_something_is_left_alone(run: Run, tmp_path: Path, hidden: bool):
    source = write(tmp_path, jaws(), "gripper.urdf")
    write(tmp_path, "mine", "taken/.mine" if hidden else "taken/hand.yaml")
    before = contents(tmp_path)
    refused(run("hands", "new", source, "--out", "taken"), "taken: exists already", "--out")
    assert contents(tmp_path) == before


def test_a_file_in_the_way_is_left_alone(run: Run, tmp_path: Path):
    source = write(tmp_path, jaws(), "gripper.urdf")
    write(tmp_path, "mine", "taken")
    before = contents(tmp_path)
    refused(run("hands", "new", source, "--out", "taken"), "taken: exists already")
    refused(run("hands", "new", source, "--out", "taken/below"), "taken")
    assert contents(tmp_path) == before


@pytest.mark.parametrize(
    "name", ["My Hand", "hand!", "../hand", "-hand", "Hand", "händ", "_x", "?"]
)
def test_a_bad_name_is_refused_with_a_better_one(run: Run, tmp_path: Path, name: str):
    source = write(tmp_path, jaws(), "gripper.urdf")
    before = contents(tmp_path)
    outcome = run("hands", "new", source, "--out", "there", "--", name)
    refused(outcome, f"'{name}'", "lower-case letters")
    (better,) = re.findall(r"e\.g\. '(.*)'", outcome.errors[0])
    assert re.fullmatch("[a-z0-9][a-z0-9_-]*", better)
    assert contents(tmp_path) == before


def test_a_folder_of_another_name_is_refused_at_once(run: Run, tmp_path: Path):
    source = write(tmp_path, jaws(), "gripper.urdf")
    before = contents(tmp_path)
    better = "Write --out deep/my_hand."
    refused(run("hands", "new", source, "my_hand", "--out", "deep/other"), "deep/other", better)
    refused(run("hands", "new", source, "--out", "My.Hand"), "is called 'my'", "--out my.")
    refused(run("hands", "new", source, "my_hand", "--out", "."), "--out my_hand.")
    assert contents(tmp_path) == before


def test_a_file_whose_name_gives_none_needs_one(run: Run, tmp_path: Path):
    source = write(tmp_path, jaws(), "手.urdf")
    refused(run("hands", "new", source), "手.urdf", "gives no name")


TURNS = '<limit lower="0" upper="1"/>'
STILL = robot(link("palm", box(), INERTIAL), link("tip", box(), INERTIAL),
              joint("j", "palm", "tip", "", "fixed"))  # fmt: skip
BARE = robot(link("palm", box(), INERTIAL), link("tip", INERTIAL),
             joint("j", "palm", "tip", TURNS))  # fmt: skip


@pytest.mark.parametrize(
    ("file", "text", "parts"),
    [
        ("hand.xacro", '<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:macro name="f"/>'
         "</robot>", ["hand.xacro", "is a xacro template", "Expand it first"]),
        ("hand.urdf", "<robot", ["hand.urdf"]),
        ("hand.urdf", "", ["hand.urdf"]),
        ("hand.urdf", STILL, ["no joint moves a link that has shapes"]),
        ("hand.urdf", BARE, ["no joint moves a link that has shapes"]),
        ("hand.urdf", finger(tip='<collision><geometry><mesh filename="package://acme/lost.stl"/>'
                             "</geometry></collision>"), ["lost.stl"]),
    ],
    ids=["xacro", "broken", "empty", "nothing-moves", "no-shape-moves", "lost-mesh"],
)  # fmt: skip
def test_what_is_no_hand_is_refused_and_leaves_nothing_behind(
    run: Run, tmp_path: Path, file: str, text: str, parts: list[str]
):
    source = write(tmp_path, text, file)
    before = contents(tmp_path)
    refused(run("hands", "new", source, "acme", "--out", "deep/down/acme"), *parts)
    assert contents(tmp_path) == before


def test_a_missing_file_is_told(run: Run, tmp_path: Path):
    refused(run("hands", "new", "lost.urdf"), "lost.urdf")
    assert contents(tmp_path) == {}


def test_an_unknown_root_is_told(run: Run, tmp_path: Path):
    source = write(tmp_path, jaws(), "gripper.urdf")
    before = contents(tmp_path)
    refused(run("hands", "new", source, "--root", "housin"), "housin", "'housing'")
    assert contents(tmp_path) == before


def interrupted(*args: object) -> None:
    raise KeyboardInterrupt


def terminated(*args: object) -> None:
    signal.raise_signal(signal.SIGTERM)


@pytest.mark.parametrize(("end", "code"), [(interrupted, 130), (terminated, 143)])
def test_an_interrupt_or_termination_leaves_nothing_behind(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: Callable[..., None], code: int
):
    monkeypatch.setattr("gdg.hands.create.propose", end)
    source, handler = write(tmp_path, jaws(), "gripper.urdf"), signal.getsignal(signal.SIGTERM)
    before = contents(tmp_path)
    outcome = run("hands", "new", source)
    assert outcome.code == code
    assert signal.getsignal(signal.SIGTERM) == handler
    assert "Traceback" not in outcome.err
    assert contents(tmp_path) == before
