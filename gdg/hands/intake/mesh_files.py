"""Finds the mesh files that a foreign URDF names, wherever its paths were meant to start."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

import defusedxml
import defusedxml.ElementTree
import trimesh

from gdg.errors import GdgError, raise_if_any
from gdg.geometry.mesh import MAX_MESH_BYTES, MESH_SUFFIXES, PARSER_ERRORS, load_mesh
from gdg.hands.intake.description import Description, Mesh, named
from gdg.hands.urdf import Link, Shape

#: So many folders above the URDF are searched (package/urdf/left/hand.urdf needs three).
MAX_PARENTS = 5
#: So many folders in each of them are looked at for a package's name.
MAX_PACKAGES = 500
#: All meshes of a hand together may have this many bytes.
MAX_TOTAL_BYTES = 500_000_000
#: Formats taken in: those that gdg reads, and binary glTF, which is written as STL. Its axes are
#: left as they are, as URDF loaders do.
SUFFIXES = (*MESH_SUFFIXES, ".glb")
#: What may stand before a path: ``package://``, ``file://``, a left-over of xacro.
SCHEMES = ("package://", "model://", "file://")
FIND = re.compile(r"\$\(find ([\w.-]+)\)")


class MeshFiles:
    """Looks for meshes at the URDF, in the folders above it and in given package folders.

    No file is taken from anywhere else, whatever the URDF names: it is untrusted.
    """

    def __init__(self, source: Path, package_paths: Sequence[Path]):
        self.source = source
        self.parents = _parents(source)
        self.packages = tuple(Path(os.path.abspath(path)) for path in package_paths)
        bases = (self.parents[-1], *self.packages)
        self._inside = tuple(Path(os.path.realpath(base)) for base in bases)

    def find(self, name: str) -> Path | None:
        """The file that a URDF means by a mesh's name; None where there is none."""
        for candidate in self._candidates(name):
            path = Path(os.path.realpath(candidate))
            inside = any(path.is_relative_to(base) for base in self._inside)
            if inside and path.suffix.lower() in SUFFIXES and os.path.isfile(path):
                return path
        return None

    def _candidates(self, name: str) -> Iterator[Path]:
        """Paths to try: as written, by the package's name, then ever shorter ends of the path."""
        name = FIND.sub(r"package://\1", name.replace("\\", "/").removeprefix("file://$"))
        scheme = next((s for s in SCHEMES if name.startswith(s)), "")
        rest = PurePosixPath(name.removeprefix(scheme))
        if scheme in ("", "file://"):
            yield self.source.parent / rest
        parts = [part for part in rest.parts if part not in ("/", "..", ".")]
        if not parts:
            return
        if scheme in ("package://", "model://"):
            for base in self._package_folders(parts[0]):
                yield base.joinpath(*parts[1:])
        for start in range(len(parts)):
            # a bare file name is looked for near by only: it could be anyone's
            near = self.parents if start < len(parts) - 1 else self.parents[:2]
            for base in (*self.packages, *near):
                yield base.joinpath(*parts[start:])
                if start == len(parts) - 1:
                    yield base.joinpath("meshes", *parts[start:])

    def _package_folders(self, package: str) -> Iterator[Path]:
        """Folders that are a package by their own name or by their ``package.xml``."""
        bases = (*self.packages, *self.parents)
        yield from (base for base in bases if base.name == package)
        for base in bases:
            if _package_name(base) == package:
                yield base
            try:
                inner = sorted(folder for folder in base.iterdir() if folder.is_dir())
            except OSError:
                continue
            yield from (f for f in inner[:MAX_PACKAGES] if _package_name(f) == package)


def _parents(source: Path) -> tuple[Path, ...]:
    """The URDF's folder and those above it, but neither the home folder nor the file system."""
    folder = Path(os.path.abspath(source)).parent
    found = [folder]
    for parent in folder.parents[:MAX_PARENTS]:
        if parent == Path(parent.anchor) or parent == Path.home():
            break
        found.append(parent)
    return tuple(found)


def _package_name(folder: Path) -> str:
    """The name in a folder's ``package.xml``; empty where there is none."""
    path = folder / "package.xml"
    try:
        if path.stat().st_size > 1_000_000:
            return ""
        root = defusedxml.ElementTree.parse(path, forbid_dtd=True).getroot()
    except (OSError, ValueError, LookupError, defusedxml.ElementTree.ParseError):
        return ""
    return ((root.findtext("name") if root is not None else None) or "").strip()


def gather_meshes(description: Description, files: MeshFiles) -> None:
    """Loads every mesh and renames it to its place in the new folder.

    A visual mesh that is lost or unreadable is dropped. A link that loses a collision mesh is left
    without collision shapes where it has a visual (whose shapes then serve), else it is refused.

    Raises:
        GdgError: collision meshes that can't be found or read, all at once; too many bytes.
    """
    gatherer = _Gatherer(description, files)
    links = {name: gatherer.link(link) for name, link in description.urdf.links.items()}
    raise_if_any(gatherer.mistakes)
    description.urdf = replace(description.urdf, links=links)
    if gatherer.lost_visuals:
        sample = "; ".join(gatherer.lost_visuals[:2])
        more = f"; and {len(gatherer.lost_visuals) - 2} more" * (len(gatherer.lost_visuals) > 2)
        description.repairs.append(f"Dropped visual meshes (for pictures only): {sample}{more}.")
    if gatherer.replaced:
        description.repairs.append(
            f"{named(gatherer.replaced)}: collision mesh not found or unreadable; the visual "
            "shapes take its place."
        )


class _Gatherer:
    """The work of ``gather_meshes``: every file is loaded once."""

    def __init__(self, description: Description, files: MeshFiles):
        self.files = files
        self.meshes = description.meshes
        self.mistakes: list[str] = []
        self.lost_visuals: list[str] = []
        self.replaced: list[str] = []
        self._names: dict[Path, str] = {}
        self._bytes = 0

    def link(self, link: Link) -> Link:
        visuals, lost = self._shapes(link.visuals)
        self.lost_visuals += [f"link '{link.name}', {reason}" for reason in lost]
        collisions, lost = self._shapes(link.collisions)
        if lost and visuals:
            self.replaced.append(link.name)
            collisions = ()
        else:
            self.mistakes += [
                f"{self.files.source}: link '{link.name}': collision {reason}" for reason in lost
            ]
        return replace(link, visuals=visuals, collisions=collisions)

    def _shapes(self, shapes: Sequence[Shape]) -> tuple[tuple[Shape, ...], list[str]]:
        kept, lost = [], []
        for shape in shapes:
            if shape.kind == "mesh":
                try:
                    shape = replace(shape, mesh=self._take(shape.mesh))
                except GdgError as error:
                    lost.append(str(error).rstrip("."))
                    continue
            kept.append(shape)
        return tuple(kept), lost

    def _take(self, name: str) -> str:
        path = self.files.find(name)
        if path is None:
            suffix = PurePosixPath(name).suffix.lower()
            if suffix not in SUFFIXES:
                raise GdgError(f"mesh '{name[:200]}' is none of {', '.join(SUFFIXES)}")
            folder = self.files.parents[-1]
            raise GdgError(
                f"mesh '{name[:200]}': no such file at the description, in the folders above it "
                f"up to {folder}, or in a --packages"
            )
        if path not in self._names:
            self._bytes += path.stat().st_size
            if self._bytes > MAX_TOTAL_BYTES:
                raise GdgError(f"mesh '{name[:200]}': over {MAX_TOTAL_BYTES // 10**6} MB in all")
            mesh = _load(path)
            target = path if mesh.file is not None else path.with_suffix(".stl")
            self._names[path] = unique_name(target, self.meshes)
            self.meshes[self._names[path]] = mesh
        return self._names[path]


def _load(path: Path) -> Mesh:
    """A mesh to copy, or, where gdg's loader does not read its format, one to write as STL.

    Raises:
        GdgError: unreadable, too large, or no mesh.
    """
    if path.suffix.lower() in MESH_SUFFIXES:
        return Mesh(load_mesh(path), path)
    if path.stat().st_size > MAX_MESH_BYTES:
        raise GdgError(f"{path}: larger than {MAX_MESH_BYTES // 10**6} MB; decimate it first.")
    try:
        # a binary glTF holds all that it needs; whatever else it names is not looked for
        with path.open("rb") as stream:
            scene: Any = trimesh.load(stream, file_type="glb", force="mesh", skip_materials=True)
        with TemporaryDirectory() as folder:
            stl = Path(folder) / f"{path.stem}.stl"
            scene.export(stl)
            return Mesh(load_mesh(stl))
    except PARSER_ERRORS as error:
        raise GdgError(f"{path}: cannot be read as a mesh: {str(error)[:200]}") from error


def unique_name(path: Path, taken: dict[str, Mesh]) -> str:
    """``meshes/<file name>``, made unlike all taken names by the name of its folder or a number.

    Letters beyond ASCII become underscores; names that differ by case only are no different.
    """
    known = {name.lower() for name in taken}
    stem, suffix = _plain(path.stem), path.suffix
    for candidate in (stem, f"{_plain(path.parent.name)}_{stem}"):
        if f"meshes/{candidate}{suffix}".lower() not in known:
            return f"meshes/{candidate}{suffix}"
    number = 2
    while f"meshes/{stem}_{number}{suffix}".lower() in known:
        number += 1
    return f"meshes/{stem}_{number}{suffix}"


def _plain(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9._-]", "_", name)[:80].lstrip(".") or "mesh"
