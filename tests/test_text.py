"""Foreign text reaches terminals without anything that they would obey."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from descriptions import box, joint, link, mesh, robot, write

from gdg.cli import main
from gdg.text import one_line


def test_one_line_has_no_control_characters():
    assert one_line("a\x1b[2J\n\tb \x9b\u2028 c\x00") == "a [2J b c"


def run(monkeypatch: pytest.MonkeyPatch, *words: object) -> object:
    monkeypatch.setattr(sys, "argv", ["gdg", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code


def test_a_refusal_shows_no_control_characters_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    parts = link("palm", mesh("\x9b2J.stl")), link("tip", box()), joint("j", "palm", "tip")
    source = write(tmp_path, robot(*parts))
    assert run(monkeypatch, "hands", "new", source, "acme", "--out", tmp_path / "acme") == 2
    told = capsys.readouterr().err
    assert "collision mesh ' 2J.stl'" in told
    assert "\x9b" not in told


def test_a_folder_of_packages_that_is_missing_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    source = write(tmp_path, robot(link("palm", box())))
    assert run(monkeypatch, "hands", "new", source, "acme", "--packages", tmp_path / "ros") == 2
    assert f"Directory '{tmp_path / 'ros'}' does not exist" in capsys.readouterr().err


def test_a_check_shows_no_control_characters_of_the_manifest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    manifest = (Path(__file__).parent.parent / "hands/barrett/hand.yaml").read_text()
    folder = tmp_path / "barrett"
    folder.mkdir()
    (folder / "hand.yaml").write_text(manifest.replace("root_link: ", 'root_link: "\\e[2J" #'))
    assert run(monkeypatch, "hands", "check", folder, "--no-pictures") == 2
    assert "\x1b" not in capsys.readouterr().out
