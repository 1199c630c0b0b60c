"""All repairs that need a description's shapes, in their order."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

from gdg.geometry.mesh import signed_volume
from gdg.hands.geometry import DECOMPOSITION
from gdg.hands.intake.choose_geometry import choose_geometry
from gdg.hands.intake.description import Description, Mesh, named
from gdg.hands.intake.inertials import mend_inertials
from gdg.hands.intake.mesh_files import unique_name
from gdg.hands.intake.surfaces import change_shapes, shapes_of, solid, surface
from gdg.hands.intake.units import check_numbers, check_size, mend_units
from gdg.hands.urdf import Shape

#: Meshes with more faces are thinned ...
MANY_FACES = 100_000
#: ... to about this many, which moves the surface of a link by micrometres.
ENOUGH_FACES = 50_000


def mend(description: Description) -> Literal["collision", "visual"]:
    """Mends a description in place and returns which of its shapes are the hand's geometry.

    Raises:
        GdgError: it has no shapes, or an impossible size.
    """
    check_numbers(description.urdf)
    mend_units(description)
    _thin_meshes(description)
    role = choose_geometry(description)
    check_size(description, role)
    mend_inertials(description, role)
    _say_what_is_cut(description, role)
    return role


def _thin_meshes(description: Description) -> None:
    thinned: dict[str, str] = {}
    for name, mesh in list(description.meshes.items()):
        faces = len(mesh.mesh.faces)
        if faces <= MANY_FACES:
            continue
        small = mesh.mesh.simplify_quadric_decimation(face_count=ENOUGH_FACES)
        del description.meshes[name]
        thinned[name] = unique_name(Path(name).with_suffix(".stl"), description.meshes)
        description.meshes[thinned[name]] = Mesh(small)
        description.repairs.append(
            f"Mesh '{Path(name).name}': {faces:,} faces thinned to {len(small.faces):,}."
        )

    def change(shape: Shape) -> Shape:
        return replace(shape, mesh=thinned.get(shape.mesh, shape.mesh))

    if thinned:
        change_shapes(description, change)


def _say_what_is_cut(description: Description, role: str) -> None:
    """Names the links whose meshes are so far from convex that loading will cut them."""
    cut = [
        name
        for name in description.urdf.links
        if any(
            shape.kind == "mesh" and _is_hollow(description, shape)
            for shape in shapes_of(description, name, role)
        )
    ]
    if cut:
        what, them = ("mesh is", "it") if len(cut) == 1 else ("meshes are", "them")
        description.repairs.append(
            f"{named(cut)}: {what} not convex; gdg will cut {them} into convex parts."
        )


def _is_hollow(description: Description, shape: Shape) -> bool:
    mesh = surface(description, shape)
    hull = solid(mesh).convex_hull
    excess = float(hull.volume) - abs(signed_volume(mesh))
    return excess / max(float(hull.area), 1e-12) > DECOMPOSITION.gap_m
