"""Which objects of the catalogue are test objects, by name and by content."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

from gdg.errors import GdgError
from gdg.folders import OBJECTS
from gdg.identity import object_hash
from gdg.objects.spec import MANIFEST, ObjectSpec, read_object_spec
from gdg.splits import bare_name

TEST = "test"


def is_test_object(name: str, content: str = "") -> bool:
    """Whether a test object of the catalogue has this bare name, or this content.

    Args:
        name: of an object, with or without its dataset and scale.
        content: content hash of its geometry; "" where only the name matters.
    """
    return bare_name(name) in catalogue_test_names() or (
        content != "" and content in catalogue_test_hashes()
    )


def catalogue_test_names() -> frozenset[str]:
    """Bare names of the test objects that gdg finds now."""
    return frozenset(bare_name(spec.name) for _, spec in _test_objects())


def catalogue_test_hashes() -> frozenset[str]:
    """Content hashes of the test objects that gdg finds now."""
    return frozenset(catalogue_tests().values())


def catalogue_tests() -> dict[str, str]:
    """Name -> content hash of the test objects that gdg finds now, "" where none can be read.

    Each mesh is read once per process.
    """
    return {
        spec.name: _hash(folder, _stamp(folder / spec.mesh)) for folder, spec in _test_objects()
    }


def _test_objects() -> Iterator[tuple[Path, ObjectSpec]]:
    for found in OBJECTS.all().values():
        if (found.path / MANIFEST).is_file():
            spec = read_object_spec(found.path)
            if spec.split == TEST:
                yield found.path, spec


def _stamp(mesh: Path) -> tuple[int, int]:
    """Time and size of a mesh, which tell that it has changed; (0, 0) where there is none."""
    try:
        status = mesh.stat()
    except OSError:
        return (0, 0)
    return status.st_mtime_ns, status.st_size


@lru_cache(maxsize=1024)
def _hash(folder: Path, stamp: tuple[int, int]) -> str:
    """Content hash of an object folder; "" where its mesh can't be read."""
    try:
        return object_hash(str(folder))
    except GdgError:
        return ""
