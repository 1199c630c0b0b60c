"""Makes one harmless MJCF text of a file and its includes, with the meshes that it names.

MuJoCo's parser gets this text and these bytes, and never a path of the description's choosing.
"""

from __future__ import annotations

import contextlib
import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from xml.etree.ElementTree import Element

from gdg.errors import GdgError
from gdg.geometry.mesh import MAX_MESH_BYTES
from gdg.hands.urdf import MAX_ELEMENTS, read_xml

#: Formats of meshes that MuJoCo reads.
MJCF_MESH_SUFFIXES = (".stl", ".obj", ".msh")
#: All meshes together may have this many bytes.
MAX_TOTAL_BYTES = 500_000_000
#: Corners of the tetrahedron that stands for a mesh that was not found.
PLACEHOLDER = "0 0 0 0.01 0 0 0 0.01 0 0 0 0.01"
#: Given to moving bodies without mass, kg, which MuJoCo would refuse.
LEAST_MASS = "1e-6"
#: MuJoCo reads angles as degrees where their unit is not stated. No hand has all its ranges below
#: this many degrees, but many files rely on another one to say that they are in radians.
MAX_TURN_RAD = 6.5
MAX_INCLUDES = 50
MAX_REPLICAS = 100
MAX_DEPTH = 100
#: More bodies, joints or geoms than these are no hand's.
MAX_MJCF_ELEMENTS = {"body": 500, "joint": 500, "geom": MAX_ELEMENTS["collision"]}
#: Elements without bearing on a hand's form and motion; several of them can be made huge.
DROPPED = frozenset(
    [
        "camera",
        "custom",
        "deformable",
        "extension",
        "flexcomp",
        "composite",
        "hfield",
        "key",
        "keyframe",
        "light",
        "material",
        "option",
        "plugin",
        "sensor",
        "size",
        "skin",
        "statistic",
        "texture",
        "visual",
    ]
)
#: Attributes whose values are words, in which "nan" is one.
WORDS = (
    "name",
    "joint",
    "joint1",
    "joint2",
    "body1",
    "body2",
    "class",
    "childclass",
    "mesh",
    "file",
)
#: Elements that join other files' models to this one.
JOINED = ("attach", "model")
#: Compiler settings that change neither units nor conventions, or would hide shapes.
COMPILER_DROPPED = (
    "assetdir", "balanceinertia", "boundinertia", "boundmass", "discardvisual", "fusestatic",
    "meshdir", "saveinertial", "strippath", "texturedir", "usethread",
)  # fmt: skip


@dataclass(frozen=True)
class Flat:
    """An MJCF description in one piece.

    Attributes:
        root: its outermost element, includes in place.
        assets: the meshes' bytes, by the names that ``root`` uses.
        missing: names of meshes whose file was not found; a placeholder stands for each.
        repairs: one sentence per repair made.
    """

    root: Element
    assets: dict[str, bytes]
    missing: dict[str, str]
    repairs: list[str]


def flatten(path: Path, root: Element, package_paths: Sequence[Path] = ()) -> Flat:
    """An MJCF file with its includes in place and its meshes read.

    Args:
        path: the file; includes and meshes must lie in the folder above its own, or below that.
        root: its outermost element; changed in place.
        package_paths: folders in which they may lie, too.

    Raises:
        GdgError: includes that are missing, files outside, too much of anything, models joined
            by file.
    """
    return _Flattener(path, package_paths).flatten(root)


class _Flattener:
    def __init__(self, path: Path, package_paths: Sequence[Path]):
        self.path = path
        self.folder = Path(os.path.abspath(path)).parent
        allowed = (self.folder.parent, *package_paths)
        self.inside = tuple(Path(os.path.realpath(folder)) for folder in allowed)
        self._folders = [self.folder]
        self._included: set[Path] = {Path(os.path.realpath(path))}
        self._bytes = 0

    def flatten(self, root: Element) -> Flat:
        root.tag = "mujoco"
        self._check_depth(root)
        self._include(root)
        self._check(root)
        _drop(root)
        mesh_folders = self._mesh_folders(root)
        flat = Flat(root, {}, {}, [])
        for mesh in root.iter("mesh"):
            if mesh.get("file") is not None:
                self._take_mesh(mesh, mesh_folders, flat)
        _set_compiler(root, flat.repairs)
        _set_armature(root)
        return flat

    def _include(self, element: Element) -> None:
        """Puts the children of included files in the place of their include elements."""
        position = 0
        while position < len(element):
            child = element[position]
            if child.tag != "include":
                self._include(child)
                position += 1
                continue
            included = self._read_include(child.get("file", ""))
            element.remove(child)
            for offset, grandchild in enumerate(list(included)):
                element.insert(position + offset, grandchild)

    def _read_include(self, name: str) -> Element:
        file = self._find("include", name, self._folders, (".xml", ".mjcf"))
        if file is None:
            raise GdgError(f"{self.path}: include '{name[:200]}': there is no such file.")
        if file in self._included or len(self._included) > MAX_INCLUDES:
            raise GdgError(f"{self.path}: includes '{name[:200]}' twice, or too many files.")
        self._included.add(file)
        if file.parent not in self._folders:
            self._folders.append(file.parent)
        root = read_xml(file)
        self._check_depth(root)
        if root.tag not in ("mujoco", "mujocoinclude"):
            raise GdgError(f"{file}: is no MJCF: the outermost element is <{root.tag}>.")
        return root

    def _find(
        self, what: str, name: str, bases: list[Path], suffixes: tuple[str, ...]
    ) -> Path | None:
        plain = PurePosixPath(name.replace("\\", "/"))
        if plain.suffix.lower() not in suffixes:
            known = ", ".join(suffixes)
            raise GdgError(f"{self.path}: {what} '{name[:200]}' is none of the kinds {known}.")
        outside = False
        for base in bases:
            file = Path(os.path.realpath(base / plain))
            if not any(file.is_relative_to(folder) for folder in self.inside):
                outside = True
            elif os.path.isfile(file):
                return file
        if outside:
            raise GdgError(
                f"{self.path}: {what} '{name[:200]}' lies outside {self.inside[0]}; name the "
                "folder that holds it with --packages, or copy all files into one folder."
            )
        return None

    def _check_depth(self, root: Element) -> None:
        layer, depth = [root], 0
        while layer:
            layer, depth = [child for element in layer for child in element], depth + 1
            if depth > MAX_DEPTH:
                raise GdgError(f"{self.path}: elements nested over {MAX_DEPTH} deep, no hand.")

    def _check(self, root: Element) -> None:
        for element in root.iter():
            for name, value in element.attrib.items():
                if name not in WORDS and "nan" in value.lower().split():
                    raise GdgError(
                        f'{self.path}: <{element.tag}> has {name}="{value[:60]}", which is no '
                        "number."
                    )
        counts = Counter(element.tag for element in root.iter())
        for tag, most in MAX_MJCF_ELEMENTS.items():
            if counts[tag] > most:
                raise GdgError(f"{self.path}: {counts[tag]} <{tag}> elements, no plausible hand.")
        for tag in JOINED:
            if counts[tag]:
                raise GdgError(
                    f"{self.path}: joins other models with <{tag}>, which gdg does not follow. "
                    "Save it as one file first: mujoco.MjSpec.from_file(FILE), then to_xml()."
                )
        copies = 1
        for element in root.iter("replicate"):
            count = element.get("count", "1")
            copies *= int(count) if count.isdecimal() and len(count) < 6 else MAX_REPLICAS + 1
        if copies > MAX_REPLICAS:
            raise GdgError(f"{self.path}: replicates parts {copies} times, no plausible hand.")

    def _mesh_folders(self, root: Element) -> list[Path]:
        """Where mesh files may be: as compilers say, then beside the files of the description."""
        stated = [
            value
            for compiler in root.iter("compiler")
            for attribute in ("meshdir", "assetdir")
            if (value := compiler.get(attribute))
        ]
        folders = [base / value for value in reversed(stated) for base in self._folders]
        return [*folders, *self._folders]

    def _take_mesh(self, mesh: Element, folders: list[Path], flat: Flat) -> None:
        name = mesh.get("file", "")
        if mesh.get("name") is None:
            mesh.set("name", PurePosixPath(name.replace("\\", "/")).stem)
        file = self._find("mesh", name, folders, MJCF_MESH_SUFFIXES)
        if file is None:
            flat.missing[mesh.get("name", "")] = name
            del mesh.attrib["file"]
            mesh.set("vertex", PLACEHOLDER)
            return
        size = file.stat().st_size
        self._bytes += size
        if size > MAX_MESH_BYTES or self._bytes > MAX_TOTAL_BYTES:
            raise GdgError(f"{file}: larger than {MAX_MESH_BYTES // 10**6} MB; decimate it first.")
        asset = f"mesh_{len(flat.assets)}{file.suffix.lower()}"
        flat.assets[asset] = file.read_bytes()
        mesh.set("file", asset)


def _drop(element: Element) -> None:
    """Removes, all the way down, what has no bearing on form and motion, and what refers to it."""
    for child in list(element):
        if child.tag in DROPPED or (child.tag == "geom" and "hfield" in child.attrib):
            element.remove(child)
        else:
            child.attrib.pop("material", None)
            _drop(child)


def _set_compiler(root: Element, repairs: list[str]) -> None:
    """Keeps every body and shape, lets placeholders of masses pass, finds the unit of angles."""
    stated = any(compiler.get("angle") for compiler in root.iter("compiler"))
    for compiler in root.iter("compiler"):
        for attribute in COMPILER_DROPPED:
            compiler.attrib.pop(attribute, None)
        for child in list(compiler):
            compiler.remove(child)
    largest = _largest_range(root)
    settings = {"balanceinertia": "true", "boundmass": LEAST_MASS, "boundinertia": "1e-12"}
    if not stated and 0.0 < largest < MAX_TURN_RAD:
        settings["angle"] = "radian"
        repairs.append(
            f"The unit of angles is not stated; ranges of at most {largest:.3g} mean radians."
        )
    compiler = Element("compiler", {**settings, "fusestatic": "false", "discardvisual": "false"})
    compiler.append(Element("lengthrange", mode="none"))
    root.append(compiler)


def _largest_range(root: Element) -> float:
    """The largest number among the ranges of hinges; 0 where there is none."""
    numbers = [0.0]
    for section in (*root.iter("worldbody"), *root.iter("default")):
        for joint in section.iter("joint"):
            if joint.get("type", "hinge") == "hinge":
                for word in joint.get("range", "").split():
                    with contextlib.suppress(ValueError):
                        numbers.append(abs(float(word)))
    return max(numbers)


def _set_armature(root: Element) -> None:
    """Gives every joint a rotor, so that bodies without mass draw no warnings.

    MuJoCo would write them to a log file in the working directory. Nothing that is read from the
    model depends on it.
    """
    for worldbody in root.iter("worldbody"):
        for joint in worldbody.iter("joint"):
            joint.set("armature", "1")
