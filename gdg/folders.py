"""Finds data folders (hands, objects) in tiers, the nearest first, without importing any."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path

import platformdirs

from gdg.errors import GdgError, did_you_mean

#: Tiers in order of precedence; an explicit path comes before all of them.
TIERS = ("environment", "user", "package", "bundled")


@dataclass(frozen=True)
class FoundFolder:
    """Where one hand or object lies.

    Attributes:
        name: what the user types.
        path: the folder (or, for an object, possibly a bare mesh file).
        tier: one of ``TIERS``, or ``path`` for an explicit path.
        origin: the directory or distribution that brought it.
        shadows: the places further down that this one hides.
        twins: other places of the same name in the same tier, which make the name ambiguous.
    """

    name: str
    path: Path
    tier: str
    origin: str
    shadows: tuple[Path, ...] = ()
    twins: tuple[Path, ...] = ()


@dataclass(frozen=True)
class FolderKind:
    """One kind of data folder and the rules by which it is found.

    Attributes:
        noun: for messages, e.g. ``hand``.
        marker: the file that makes a folder one of this kind, e.g. ``hand.yaml``.
        variable: environment variable with a list of directories to search.
        group: entry-point group of packages that carry such folders; each entry point's value
            is the package's import name, dotted or not, located but never imported.
        bare_suffixes: file suffixes that stand for a folder by themselves (bare meshes).
        file_hint: what to do with another file that was given in place of a folder.
    """

    noun: str
    marker: str
    variable: str
    group: str
    bare_suffixes: tuple[str, ...] = ()
    file_hint: str = ""

    def user_directory(self) -> Path:
        """The user's own data directory for this kind; it need not exist."""
        return Path(platformdirs.user_data_dir("gdg")) / f"{self.noun}s"

    def find(self, given: str) -> FoundFolder:
        """The folder that ``given`` names: an explicit path, else the nearest tier's.

        Raises:
            GdgError: no such path or name (with a suggestion), or the name stands twice in
                the nearest tier that has it.
        """
        path = Path(os.path.expanduser(given))
        try:
            if self._is_path(given, path):
                return self._explicit(given, path)
            found = self.all()
            if given in found:
                return self._unambiguous(found[given])
            if path.exists():
                return self._explicit(given, path)
        except OSError as error:
            raise GdgError(f"{self.noun} '{given[:80]}': {error.strerror or error}.") from error
        raise GdgError(
            f"Unknown {self.noun} '{given}'.{did_you_mean(given, found)} "
            f"A folder is given by its path, e.g. ./{given}."
        )

    def _is_path(self, given: str, path: Path) -> bool:
        marked = os.sep in given or given.startswith((".", "~"))
        return marked or path.suffix.lower() in self.bare_suffixes

    def _explicit(self, given: str, path: Path) -> FoundFolder:
        if path.is_file() and path.suffix.lower() in self.bare_suffixes:
            return FoundFolder(path.stem, path.resolve(), "path", str(path.parent))
        if path.is_file():
            meshes = f" or a mesh ({', '.join(self.bare_suffixes)})" if self.bare_suffixes else ""
            raise GdgError(
                f"{self.noun} '{given}': is a file, not a folder with {self.marker}{meshes}."
                f"{self.file_hint}"
            )
        if not path.exists():
            raise GdgError(f"{self.noun} '{given}': there is no such file or folder.")
        if not (path / self.marker).is_file():
            raise GdgError(f"{self.noun} '{given}': the folder has no {self.marker}.")
        return FoundFolder(path.resolve().name, path.resolve(), "path", str(path.parent))

    def all(self) -> dict[str, FoundFolder]:
        """Every folder that can be named, by name, the nearest tier winning."""
        places: dict[str, list[FoundFolder]] = {}
        for tier in TIERS:
            for origin, directory in self._directories(tier):
                for name, path in self._folders_in(directory):
                    places.setdefault(name, []).append(FoundFolder(name, path, tier, origin))
        return {name: _nearest(found) for name, found in sorted(places.items())}

    def _unambiguous(self, found: FoundFolder) -> FoundFolder:
        if found.twins:
            raise GdgError(
                f"{self.noun} '{found.name}' stands twice in the tier '{found.tier}': "
                f"{found.path} and {found.twins[0]}. Rename one, or give the path of the one "
                f"you mean."
            )
        return found

    def _directories(self, tier: str) -> Iterator[tuple[str, Path]]:
        if tier == "environment":
            for part in filter(None, os.environ.get(self.variable, "").split(os.pathsep)):
                directory = Path(os.path.expanduser(part))
                if not directory.is_dir():
                    raise GdgError(f"{self.variable}: '{part}' is not a directory.")
                yield str(directory), directory
        elif tier == "user":
            yield str(self.user_directory()), self.user_directory()
        else:
            for point in metadata.entry_points(group=self.group):
                distribution = point.dist.name if point.dist else "?"
                if (distribution == "gdg") == (tier == "bundled"):
                    for directory in _package_directories(point.value):
                        yield distribution, directory

    def _folders_in(self, directory: Path) -> Iterator[tuple[str, Path]]:
        if not directory.is_dir():
            return
        for path in sorted(directory.iterdir()):
            if path.name.startswith("."):
                continue
            if (path / self.marker).is_file():
                yield path.name, path.resolve()
            elif path.is_file() and path.suffix.lower() in self.bare_suffixes:
                yield path.stem, path.resolve()


def _nearest(found: list[FoundFolder]) -> FoundFolder:
    first = found[0]
    others = {other.path: other for other in found[1:] if other.path != first.path}.values()
    return replace(
        first,
        twins=tuple(other.path for other in others if other.tier == first.tier),
        shadows=tuple(other.path for other in others if other.tier != first.tier),
    )


def _package_directories(package: str) -> list[Path]:
    """Directories of a package, found without importing it; of ``a.b``, the folder b of a."""
    top, *rest = package.split(".")
    try:
        spec = importlib.util.find_spec(top)
    except ValueError:  # a module that was made by hand and has no spec
        return []
    locations = spec.submodule_search_locations if spec is not None else None
    return [Path(location).joinpath(*rest) for location in locations or ()]


HANDS = FolderKind(
    "hand",
    "hand.yaml",
    "GDG_HANDS_PATH",
    "gdg.hands",
    file_hint=" Make a folder of a URDF or MJCF file first: gdg hands new FILE",
)
OBJECTS = FolderKind(
    "object", "object.yaml", "GDG_OBJECTS_PATH", "gdg.objects", (".stl", ".obj", ".ply", ".off")
)
