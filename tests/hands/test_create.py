"""Refusals of ``create_hand`` name what the user gave, and leave nothing behind."""

from __future__ import annotations

from pathlib import Path

import pytest
import trimesh
from descriptions import INERTIAL, box, joint, link, mesh, robot, write

from gdg.errors import GdgError
from gdg.hands.create import create_hand
from gdg.testing.fixtures import model_of


def refusal(source: Path, folder: Path) -> str:
    with pytest.raises(GdgError) as caught:
        create_hand(source, folder, "acme", model_of)
    assert not folder.parent.exists()
    return str(caught.value)


def test_a_hand_that_does_not_move_is_refused_by_the_name_of_its_file(tmp_path: Path):
    text = robot(
        link("palm", box(), INERTIAL), link("tip", box()), joint("j", "palm", "tip", kind="fixed")
    )
    source = write(tmp_path, text)
    message = refusal(source, tmp_path / "made" / "acme")
    assert message.startswith(f"{source}: ")
    assert ".acme-" not in message


def test_a_mesh_without_volume_is_refused_by_the_name_of_the_file(tmp_path: Path):
    parts = link("palm", mesh("flat.stl"), INERTIAL), link("tip", box(), INERTIAL)
    source = write(tmp_path, robot(*parts, joint("j", "palm", "tip")))
    square = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 1, 2]])
    square.export(source.parent / "flat.stl")
    message = refusal(source, tmp_path / "made" / "acme")
    assert message.startswith(f"{source}: link 'palm': mesh 'meshes/flat.stl': ")
    assert ".acme-" not in message


def test_foreign_names_in_the_readme_are_shown_as_they_are(tmp_path: Path):
    tip = "a|b`<script>"
    palm, finger = link("palm", box(), INERTIAL), link(quoted(tip), box(), INERTIAL)
    comment = "<!-- Copyright ![x](http://x.test/x.png) -->"
    parts = comment, palm, finger, joint("[j](x)", "palm", quoted(tip))
    create_hand(write(tmp_path, robot(*parts)), tmp_path / "acme", "acme", model_of)
    readme = (tmp_path / "acme" / "README.md").read_text()
    assert r"| 1 | `[j](x)` | a\|b\`\<script\> |" in readme
    assert r"Copyright !\[x\](http://x.test/x.png)" in readme


def quoted(name: str) -> str:
    return name.replace("<", "&lt;").replace(">", "&gt;")
