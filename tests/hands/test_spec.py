"""Each mistake in hand.yaml gives one sentence that says where it is and what to write."""

from __future__ import annotations

from pathlib import Path

import pytest
from gripper import MANIFEST as GRIPPER

from gdg.errors import GdgError, GdgErrors
from gdg.hands.spec import MANIFEST, HandSpec, read_spec


def spec_of(folder: Path, *changes: tuple[str, str]) -> HandSpec:
    text = GRIPPER
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / MANIFEST).write_text(text, encoding="utf-8")
    return read_spec(folder)


def test_a_good_manifest_is_read(tmp_path: Path):
    spec = spec_of(tmp_path)
    assert spec.name == "two_jaws"
    assert spec.joints == ("close",)
    assert spec.closed == {"close": 0.05}
    assert spec.drives.of("close").stiffness == 2000
    assert spec.geometry == "collision"


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("name: two_jaws", "name: Two Jaws", "name: String should match pattern"),
        ("name: two_jaws", "name: ../x", "name: String should match pattern"),
        ("title: Two parallel jaws", 'title: "\\e[2J"', "title: must not hold control characters"),
        ("name: two_jaws\n", "", "name: must be given."),
        ("urdf: two_jaws.urdf", "urdf: ../x.urdf", "urdf: must be a path inside the folder"),
        ("urdf: two_jaws.urdf", "urdf: /etc/passwd", "urdf: must be a path inside the folder"),
        ("urdf: two_jaws.urdf", 'urdf: "a\\0b"', "urdf: must be a path inside the folder"),
        ("normal: [0, 0, 1]", "normal: [0, 0, 2]", "palm.normal: must be a unit vector"),
        ("normal: [0, 0, 1]", "normal: [0, 0, 0]", "palm.normal: must be a unit vector"),
        ("normal: [0, 0, 1]", "normal: [0, 0]", "palm.normal.2: must be given."),
        ("center: [0, 0, 0]", "center: [0, 0, .nan]", "palm.center.2: must be a finite number"),
        ("center: [0, 0, 0]", "center: [0, 0, .inf]", "palm.center.2: must be a finite number"),
        ("center:", "centre:", "palm.centre: there is no such option. Did you mean 'center'?"),
        ("joints: [close]", "joints: []", "joints: Tuple should have at least 1 item"),
        ("joints: [close]", "joints: close", "joints: Input should be a valid tuple"),
        ("open: {close: 0.0}", "open: {close: wide}", "open.close: Input should be a valid number"),
        ("closed: {close: 0.05}", "closed: {close: .nan}", "closed.close: must be a finite number"),
        ("title:", "titel:", "titel: there is no such option. Did you mean 'title'?"),
        ("stiffness: 2000", "stiffness: 0", "drives.default.stiffness: Input should be greater"),
        ("stiffness: 2000", "stiffness: .inf", "drives.default.stiffness: must be a finite"),
        ("damping: 100", "damping: -1", "drives.default.damping: Input should be greater"),
        ("damping: 100", "dampin: 1", "dampin: there is no such option. Did you mean 'damping'?"),
        ("licence: Apache-2.0", "license: Apache-2.0", "provenance.licence: must be given."),
        ("title: Two parallel jaws", "geometry: visuals", "geometry: Input should be 'collision'"),
        ("[-0.015, 0, 0.06]]\n  right", "[-0.015, 0, 0.06], [0, 0, 0]]\n  right", "left.0"),
        ("[[-0.015, 0, 0.01], [0.015, 0, 0.01], [0.015, 0, 0.06], [-0.015, 0, 0.06]]",
         "[[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]]",
         "contact_regions.left.0: the corners span no area"),
    ],
)  # fmt: skip
def test_a_mistake_is_named_by_its_dotted_place(tmp_path: Path, old: str, new: str, reason: str):
    with pytest.raises(GdgErrors) as caught:
        spec_of(tmp_path, (old, new))
    path = tmp_path / MANIFEST
    assert all(message.startswith(f"{path}: ") for message in caught.value.messages)
    assert any(reason in message for message in caught.value.messages), caught.value.messages


def test_crossed_corners_are_refused(tmp_path: Path):
    crossed = "[[-0.015, 0, 0.01], [0.015, 0, 0.06], [0.015, 0, 0.01], [-0.015, 0, 0.06]]"
    straight = "[[-0.015, 0, 0.01], [0.015, 0, 0.01], [0.015, 0, 0.06], [-0.015, 0, 0.06]]"
    with pytest.raises(GdgErrors, match="the corners span no area"):
        spec_of(tmp_path, (straight, crossed))


def test_all_mistakes_are_reported_at_once(tmp_path: Path):
    with pytest.raises(GdgErrors) as caught:
        spec_of(tmp_path, ("title:", "titel:"), ("name: two", "name: Two"), ("palm,", "3,"))
    assert len(caught.value.messages) == 3


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "must be a mapping"),
        ("- a\n- b", "must be a mapping"),
        ("name: [", "is no valid YAML: line 1"),
        ("name: a\nname: b", "line 2: the key 'name' stands twice"),
        ("a: &a [x]\nb: *a", "aliases"),
        ("a: !!python/name:os.system", "is no valid YAML"),
        ("name: " + "[" * 50_000, "nested too deeply"),
    ],
)
def test_what_is_no_manifest_is_refused(tmp_path: Path, text: str, reason: str):
    (tmp_path / MANIFEST).write_text(text)
    with pytest.raises(GdgError) as caught:
        read_spec(tmp_path)
    assert str(caught.value).startswith(str(tmp_path / MANIFEST))
    assert reason in str(caught.value)


def test_a_folder_without_manifest_is_named(tmp_path: Path):
    with pytest.raises(GdgError, match=r"hand\.yaml: cannot be read: No such file"):
        read_spec(tmp_path)


def test_a_huge_manifest_is_refused_unread(tmp_path: Path):
    with (tmp_path / MANIFEST).open("wb") as stream:
        stream.truncate(10**9)
    with pytest.raises(GdgError, match="larger than"):
        read_spec(tmp_path)
