"""The five real hands: our manifests in ``tests/hands`` joined with the makers' URDFs and meshes.

The makers' files aren't ours to ship. ``assemble`` copies them from the asset folder
(``GDG_TEST_ASSETS``) beside our manifests, so that each becomes an ordinary hand folder::

    python tests/real_hands.py build/real-hands
    export GDG_HANDS_PATH=build/real-hands
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
MANIFESTS = REPOSITORY / "tests" / "hands"
ASSETS = Path(os.environ.get("GDG_TEST_ASSETS", REPOSITORY.parent / "shared" / "assets"))
HANDS = ("ezgripper", "barrett", "robotiq_3finger", "allegro", "shadowhand")


def have_assets() -> bool:
    """Whether the asset folder holds the URDF of every real hand."""
    return all((ASSETS / "hands" / hand / f"{hand}.urdf").is_file() for hand in HANDS)


def assemble(out: Path) -> Path:
    """Writes one complete hand folder per real hand into ``out`` and returns ``out``.

    Copies, never links: the loader refuses paths that leave a hand's folder. Files that are up to
    date are left alone.

    Raises:
        FileNotFoundError: the asset folder is missing or incomplete.
    """
    if not have_assets():
        raise FileNotFoundError(
            f"{ASSETS}: hands missing; set GDG_TEST_ASSETS to the asset folder."
        )
    for hand in HANDS:
        for source, name in _files(hand):
            _copy(source, out / hand / name)
    return out


def _files(hand: str) -> Iterator[tuple[Path, Path]]:
    yield MANIFESTS / hand / "hand.yaml", Path("hand.yaml")
    folder = ASSETS / "hands" / hand
    yield folder / f"{hand}.urdf", Path(f"{hand}.urdf")
    for mesh in sorted((folder / "meshes").iterdir()):
        yield mesh, Path("meshes") / mesh.name


def _copy(source: Path, target: Path) -> None:
    wanted = source.stat()
    if target.is_file():
        found = target.stat()
        if (found.st_size, found.st_mtime) == (wanted.st_size, wanted.st_mtime):
            return
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy2(source, target)


if __name__ == "__main__":
    folder = assemble(Path(sys.argv[1] if len(sys.argv) > 1 else "build/real-hands"))
    print(f"{len(HANDS)} hands in {folder}")
    print(f"export GDG_HANDS_PATH={folder}")
