"""Real objects where there are some, else the bundled ones; and it is said which."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gdg.bench.assets import TEST_OBJECTS, bench_objects, told_hands
from gdg.config import _split_commas
from gdg.errors import GdgError
from gdg.objects.spec import read_object_spec


def paths(word: str) -> list[Path]:
    return [Path(json.loads(part)) for part in _split_commas(word.partition("=")[2])]


def write_assets(folder: Path, *names: str) -> Path:
    (folder / "objects").mkdir(parents=True)
    (folder / "objects" / "splits.json").write_text(json.dumps({"train": ["a"], "test": names}))
    for name in names:
        dataset, _, bare = name.partition("+")
        mesh = folder / "objects" / dataset / f"{bare}.stl"
        mesh.parent.mkdir(exist_ok=True)
        mesh.touch()
    return folder


def test_the_ten_bundled_test_objects():
    found = bench_objects()
    assert found.told == "10 bundled test objects"
    assert [path.name for path in paths(found.word)] == list(TEST_OBJECTS)
    assert {read_object_spec(path).split for path in paths(found.word)} == {"test"}
    assert len(paths(bench_objects(2).word)) == 2


def test_bundled_objects_are_found_beneath_meshes_of_their_name(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    (tmp_path / "apple.stl").touch()
    monkeypatch.setenv("GDG_OBJECTS_PATH", str(tmp_path))
    assert bench_objects(1).word == bench_objects(1).word
    (apple,) = paths(bench_objects(1).word)
    assert apple.is_dir()


def test_real_objects_of_the_asset_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    assets = write_assets(tmp_path / "a, b", "ycb+pear", "contactdb+apple", "ycb+baseball")
    monkeypatch.setenv("GDG_TEST_ASSETS", str(assets))
    found = bench_objects(2)
    assert found.told == "2 real test objects (GDG_TEST_ASSETS)"
    assert [path.stem for path in paths(found.word)] == ["apple", "baseball"]


def test_a_broken_asset_folder_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("GDG_TEST_ASSETS", str(tmp_path))
    with pytest.raises(GdgError, match=r"GDG_TEST_ASSETS.*unset"):
        bench_objects()
    assets = write_assets(tmp_path / "b", "ycb+pear")
    (assets / "objects" / "ycb" / "pear.stl").unlink()
    monkeypatch.setenv("GDG_TEST_ASSETS", str(assets))
    with pytest.raises(GdgError, match=r"pear\.stl"):
        bench_objects()


def test_it_is_told_where_hands_come_from():
    told = told_hands(["two_jaws", "allegro", "allegro"])
    assert told == "two_jaws (a hand folder of GDG_HANDS_PATH), allegro (the bundled hand)"
