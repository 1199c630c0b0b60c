"""Takes in a foreign description of a hand: a clean URDF with its meshes in a folder of its own."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from gdg.errors import GdgError
from gdg.hands.intake.description import Description
from gdg.hands.intake.mesh_files import MeshFiles, gather_meshes
from gdg.hands.intake.mjcf import mjcf_from_xml
from gdg.hands.intake.provenance import find_licence, stated_source
from gdg.hands.intake.repairs import mend
from gdg.hands.intake.urdf_files import declare_prefixes, urdf_from_xml
from gdg.hands.intake.write_urdf import write_urdf
from gdg.hands.spec import Drive
from gdg.hands.urdf import parse_xml, read_limited, read_urdf
from gdg.text import one_line


@dataclass(frozen=True)
class Intake:
    """What a foreign description became.

    Attributes:
        urdf: the clean URDF, in the new folder; its meshes are in ``meshes/`` beside it.
        geometry: which of its shapes are the hand's one geometry; ``visual`` where the collision
            shapes are missing, or placeholders far inside the visual surface.
        actuated: joints that the description says are driven; None where it doesn't say.
        drives: gains and force limits by joint, where it states them.
        excluded: pairs of links that it excludes from contact.
        repairs: one plain sentence per repair, in the order in which they were made.
        source: format, file and robot name, and what the file says about its authors.
        licence: name of the licence that comes with the description, or the beginning of its
            text; None where none was found.
    """

    urdf: Path
    geometry: Literal["collision", "visual"]
    actuated: tuple[str, ...] | None
    drives: dict[str, Drive]
    excluded: tuple[tuple[str, str], ...]
    repairs: tuple[str, ...]
    source: str
    licence: str | None


def take_in(
    source: Path,
    folder: Path,
    name: str,
    root: str | None = None,
    package_paths: Sequence[Path] = (),
) -> Intake:
    """Turns a URDF or MJCF file into ``<folder>/<name>.urdf`` and ``<folder>/meshes``.

    Nothing is written before the whole description is read and mended. Files of the same name in
    the folder are replaced.

    Args:
        source: the description, untrusted.
        folder: made where it does not exist.
        name: of the URDF and the robot in it.
        root: keep only this link and what hangs on it.
        package_paths: folders in which ROS packages and other files of the description lie,
            beside those above ``source``.

    Raises:
        GdgError: what can't be read or mended; says what to do instead.
    """
    description = _read(source, root, package_paths)
    geometry = mend(description)
    urdf = _write(description, folder, name)
    return Intake(
        urdf=urdf,
        geometry=geometry,
        actuated=description.actuated,
        drives=description.drives,
        excluded=description.excluded,
        repairs=tuple(map(one_line, description.repairs)),
        source=description.source,
        licence=find_licence(source),
    )


def _read(source: Path, root: str | None, package_paths: Sequence[Path]) -> Description:
    xml = parse_xml(source, declare_prefixes(read_limited(source)))
    if xml.tag == "sdf":
        raise GdgError(f"{source}: is an SDF file; gdg takes in URDF and MJCF. Convert it first.")
    if xml.tag in ("mujoco", "mujocoinclude"):
        return mjcf_from_xml(source, xml, root, package_paths)
    repairs: list[str] = []
    robot_name = xml.get("name", "")
    urdf, actuated = urdf_from_xml(source, xml, root, repairs)
    description = Description(
        urdf, stated_source(source, "URDF", robot_name), actuated=actuated, repairs=repairs
    )
    gather_meshes(description, MeshFiles(source, package_paths))
    return description


def _write(description: Description, folder: Path, name: str) -> Path:
    used = {
        shape.mesh
        for link in description.urdf.links.values()
        for shape in (*link.visuals, *link.collisions)
    }
    path = folder / f"{name}.urdf"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for mesh_name, mesh in description.meshes.items():
            if mesh_name not in used:
                continue
            target = folder / mesh_name
            target.parent.mkdir(exist_ok=True)
            if mesh.file is not None:
                shutil.copyfile(mesh.file, target)
            else:
                mesh.mesh.export(target, file_type="stl")
        path.write_text(write_urdf(description.urdf, name), encoding="utf-8")
    except OSError as error:
        raise GdgError(f"{folder}: cannot be written: {error.strerror or error}") from error
    read_urdf(path)
    return path
