"""Which hands and objects a table is measured with, and how that is told. Light."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

from gdg.errors import GdgError
from gdg.folders import HANDS, OBJECTS
from gdg.objects.spec import MANIFEST, read_object_spec

#: Environment variable with a folder of published hands and objects.
ASSETS = "GDG_TEST_ASSETS"
#: The paper's test objects.
TEST_OBJECTS = (
    "apple", "baseball", "camera", "cylinder_medium", "door_knob", "pear", "potted_meat_can",
    "rubber_duck", "tomato_soup_can", "water_bottle",
)  # fmt: skip
#: Where hands come from, in words.
_TIERS = {
    "path": "a folder given by path",
    "environment": "a hand folder of GDG_HANDS_PATH",
    "user": "the user's own hand folder",
    "package": "a hand folder of a package",
    "bundled": "the bundled hand",
}


@dataclass(frozen=True)
class BenchObjects:
    """The objects of a table.

    Attributes:
        word: the setting ``object=…`` that sweeps them.
        told: where they come from, for captions.
    """

    word: str
    told: str


def bench_objects(most: int = len(TEST_OBJECTS)) -> BenchObjects:
    """The paper's test objects: the real meshes where the asset folder has them, else the bundled.

    Args:
        most: how many, the first by name.

    Raises:
        GdgError: ``GDG_TEST_ASSETS`` names a folder without a readable ``objects/splits.json`` or
            without one of the meshes; or a bundled test object is missing.
    """
    given = os.environ.get(ASSETS)
    found = _real_objects(Path(given).expanduser()) if given else _bundled_objects()
    chosen = found[:most]
    told = f"real test objects ({ASSETS})" if given else "bundled test objects"
    # quoted: a path may hold commas
    word = ",".join(json.dumps(place, ensure_ascii=False) for place in chosen)
    return BenchObjects(f"object={word}", f"{len(chosen)} {told}")


def told_hands(names: list[str]) -> str:
    """Where the hands of a table come from, for captions.

    Raises:
        GdgError: a hand can't be found.
    """
    return ", ".join(f"{name} ({_TIERS[HANDS.find(name).tier]})" for name in dict.fromkeys(names))


def _real_objects(assets: Path) -> tuple[str, ...]:
    splits = assets / "objects" / "splits.json"
    try:
        listed = json.loads(splits.read_text(encoding="utf-8"))["test"]
        meshes = [_mesh(assets, str(name)) for name in sorted(listed, key=_bare)]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise GdgError(
            f"{ASSETS}: {splits} can't be read as the list of test objects ({error}); unset "
            f"{ASSETS} to use the bundled objects."
        ) from error
    for mesh in meshes:
        if not mesh.is_file():
            raise GdgError(f"{ASSETS}: the mesh of a test object is missing: {mesh}.")
    return tuple(map(str, meshes))


def _mesh(assets: Path, name: str) -> Path:
    dataset, _, bare = name.partition("+")
    return (assets / "objects" / dataset / f"{bare}.stl").resolve()


def _bare(name: object) -> str:
    return str(name).rpartition("+")[2]


def _bundled_objects() -> tuple[str, ...]:
    """Folders of the test objects, also of those that a bare mesh of the same name hides."""
    found = OBJECTS.all()
    folders = []
    for name in TEST_OBJECTS:
        places = (found[name].path, *found[name].shadows) if name in found else ()
        tests = [path for path in places if (path / MANIFEST).is_file()]
        tests = [path for path in tests if read_object_spec(path).split == "test"]
        if not tests:
            raise GdgError(f"the test object '{name}' is not found; reinstall gdg.")
        folders.append(str(tests[-1]))  # the farthest tier is the bundled one
    return tuple(folders)
