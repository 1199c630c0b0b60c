"""A layout is told by the names of files; where that is not possible, the user is asked."""

from __future__ import annotations

from pathlib import Path

import pytest

from gdg.data.layouts import LAYOUTS, detect_layout
from gdg.errors import GdgError


@pytest.mark.parametrize(
    ("name", "layout"),
    [
        ("barrett.pt", "multidex"),
        ("cmap_dataset.pt", "cmap"),
        ("core-mug-1.npy", "dexgraspnet"),
        ("all.parquet", "compact"),
        ("multidex/barrett/barrett.pt", "multidex"),
        ("multidex/robot_object_names.json", ""),
    ],
)
def test_files_and_folders_are_told_by_their_names(tmp_path: Path, name: str, layout: str) -> None:
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    given = {path, tmp_path / Path(name).parts[0]}
    for one in given:
        if layout:
            assert detect_layout([one]) == layout
        else:
            with pytest.raises(GdgError, match="write --layout multidex or cmap"):
                detect_layout([one])


def test_files_of_several_layouts_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.pt").touch()
    (tmp_path / "a.npy").touch()
    with pytest.raises(GdgError, match=r"different layouts \(dexgraspnet, multidex\)"):
        detect_layout([tmp_path / "a.pt", tmp_path / "a.npy"])


def test_every_layout_is_explained() -> None:
    assert all(len(text) > 50 for text in LAYOUTS.values())
