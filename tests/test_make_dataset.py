"""The recipe of the dataset, tools/make_dataset.py."""

from __future__ import annotations

import importlib
import json
import os
import sys
from pathlib import Path
from types import ModuleType

import pytest

from gdg.cli.settings import configs_from
from gdg.errors import GdgError
from gdg.folders import OBJECTS
from gdg.pipeline.jobs import SYNTH_DEFAULTS, SynthJob

TOOLS = Path(__file__).resolve().parents[1] / "tools"


@pytest.fixture
def recipe(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(TOOLS))
    monkeypatch.setenv("GDG_OBJECTS_PATH", "")
    return importlib.import_module("make_dataset")


@pytest.fixture
def published(tmp_path: Path) -> Path:
    """Three meshes, of which two are train objects."""
    folder = tmp_path / "published"
    names = ("ycb+pen", "ycb+pot", "ycb+pan")
    for name in names:
        mesh = folder / "ycb" / f"{name}.stl"
        mesh.parent.mkdir(parents=True, exist_ok=True)
        mesh.write_text("solid")
    splits = {"train": list(names[:2]), "validate": [names[2]]}
    (folder / "splits.json").write_text(json.dumps(splits))
    files = {name: {"file": f"ycb/{name}.stl"} for name in names}
    (folder / "objects.json").write_text(json.dumps(files))
    return folder


def words_of(recipe: ModuleType, monkeypatch: pytest.MonkeyPatch, *given: str) -> list[str]:
    """What the recipe gives to gdg."""
    monkeypatch.setattr(recipe, "gdg", lambda: None)
    monkeypatch.setattr(sys, "argv", ["make_dataset.py", *given])
    recipe.main()
    return sys.argv[1:]


def test_published_train_meshes_are_found_under_their_names(
    recipe: ModuleType, published: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    given = (str(tmp_path / "set"), "--published", str(published))
    words = words_of(recipe, monkeypatch, *given)
    assert words[0] == "synth"
    assert "object=train,ycb+pen,ycb+pot" in words
    assert OBJECTS.find("ycb+pot").path.resolve() == (published / "ycb" / "ycb+pot.stl").resolve()
    assert not (tmp_path / "set-meshes" / "ycb+pan.stl").exists()


def test_settings_that_follow_win_over_the_recipe(
    recipe: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    words = words_of(recipe, monkeypatch, str(tmp_path / "set"), "n=7", "hand=barrett")
    configs = configs_from(SynthJob, SYNTH_DEFAULTS, (), words[1:])
    assert {config.job.hand for config in configs} == {"barrett"}
    assert {config.job.n for config in configs} == {7}
    assert {config.job.max_shards for config in configs} == {8}


def test_links_follow_meshes_that_moved(recipe: ModuleType, published: Path, tmp_path: Path):
    recipe.link_published(published, tmp_path / "links")
    moved = tmp_path / "moved"
    os.rename(published, moved)
    assert recipe.link_published(moved, tmp_path / "links") == ["ycb+pen", "ycb+pot"]
    assert (tmp_path / "links" / "ycb+pen.stl").read_text() == "solid"


def test_a_folder_without_the_lists_or_a_mesh_is_refused_by_name(
    recipe: ModuleType, published: Path, tmp_path: Path
):
    (published / "ycb" / "ycb+pot.stl").unlink()
    with pytest.raises(GdgError, match=r"ycb\+pot\.stl: No such file"):
        recipe.link_published(published, tmp_path / "links")
    with pytest.raises(GdgError, match=r"splits\.json: No such file"):
        recipe.link_published(tmp_path, tmp_path / "links")
    (published / "objects.json").write_text("{}")
    with pytest.raises(GdgError, match="malformed"):
        recipe.link_published(published, tmp_path / "links")
    assert not (tmp_path / "links").exists()


def test_a_word_that_is_no_setting_is_refused(
    recipe: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with pytest.raises(SystemExit) as ended:
        words_of(recipe, monkeypatch, str(tmp_path / "set"), "fast")
    assert ended.value.code == 2
