"""Finds meshes and whole descriptions that are in millimetres, and writes them in metres."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from gdg.errors import GdgError, raise_if_any
from gdg.hands.intake.description import Description
from gdg.hands.intake.surfaces import change_shapes, extents
from gdg.hands.urdf import Inertial, Joint, Link, Shape, Urdf

#: No link is longer than this, metres, ...
MAX_LINK_M = 2.0
#: ... and no chain of joints; what is longer has been written in millimetres.
MAX_REACH_M = 10.0
#: Where one mesh is in millimetres, so are those with the same scale that are longer than this.
SUSPECT_M = 0.3
#: Meshes that are all smaller than this, metres, have been scaled down twice.
MIN_MESH_M = 1e-3
#: Numbers above the first, and sizes of shapes below the second, in any unit, are mistakes.
MAX_NUMBER, MIN_SIZE = 1e6, 1e-9
#: Sizes between which the whole of a hand is plausible, and possible, metres.
PLAUSIBLE_M = (0.03, 1.2)
POSSIBLE_M = (0.005, 5.0)
#: Units other than the metre that meshes are drawn in.
UNITS = {"millimetres": 1e-3, "centimetres": 1e-2}
#: A link's mesh is about so much longer than the distance of its joints.
MESH_PER_OFFSET = 1.5


def mend_units(description: Description) -> None:
    """Scales what is too large or too small for a hand by a factor that the joints confirm.

    Raises:
        GdgError: no unit makes the hand plausible.
    """
    if _reach(description.urdf) > MAX_REACH_M:
        description.urdf = _scaled(description.urdf, 1e-3)
        description.repairs.append(
            "All lengths of the description were in millimetres; now in metres."
        )
    _mend_large_meshes(description)
    _mend_small_meshes(description)


def check_numbers(urdf: Urdf) -> None:
    """Refuses figures with which no computation would end well.

    Raises:
        GdgError: lengths, masses or inertias that are absurd, all at once.
    """
    mistakes = []
    for name, link in urdf.links.items():
        for shape in (*link.collisions, *link.visuals):
            sizes = np.abs([*shape.size, *shape.T_link_shape[:3, 3]])
            if sizes.max() > MAX_NUMBER or sizes[: len(shape.size)].min() < MIN_SIZE:
                mistakes.append(f"link '{name}': a {shape.kind} has an absurd size or place.")
        inertial = link.inertial
        if inertial is not None:
            center = inertial.T_link_center[:3, 3]
            values = np.abs([inertial.mass, *center, *inertial.inertia.ravel()])
            if values.max() > MAX_NUMBER:
                mistakes.append(f"link '{name}': its mass properties are absurdly large.")
    for name, joint in urdf.joints.items():
        if np.abs(joint.T_parent_child[:3, 3]).max() > MAX_NUMBER:
            mistakes.append(f"joint '{name}': it is absurdly far from its parent's origin.")
    raise_if_any([f"{urdf.path}: {mistake}" for mistake in mistakes])


def check_size(description: Description, role: str) -> None:
    """Refuses a hand of impossible size; says so where it is larger or smaller than hands are."""
    size = float(extents(description, role).max())
    text = f"{size:.3g} m" if size >= 1 else f"{size * 1000:.3g} mm"
    if not POSSIBLE_M[0] <= size <= POSSIBLE_M[1]:
        raise GdgError(
            f"{description.urdf.path}: the hand would be {text} long; a hand is 3 cm to 1.2 m. "
            "Check the units of its lengths and the scale of its meshes."
        )
    if size > PLAUSIBLE_M[1]:
        description.repairs.append(
            f"Not repaired: it is {text} long. If it has an arm, cut that off with --root LINK."
        )
    elif size < PLAUSIBLE_M[0]:
        description.repairs.append(f"Not repaired: it is only {text} long. Are its units right?")


def _mend_large_meshes(description: Description) -> None:
    lengths = _mesh_lengths(description)
    wrong = {key for key, length in lengths.items() if length > MAX_LINK_M}
    if not wrong:
        return
    scales = {scale for _, scale in wrong}
    wrong |= {key for key, length in lengths.items() if key[1] in scales and length > SUSPECT_M}
    unit = _likely_unit(description.urdf, [lengths[key] for key in wrong])
    _scale_meshes(description, wrong, UNITS[unit])
    description.repairs.append(
        f"{len(wrong)} meshes were in {unit}: scale {UNITS[unit]:g} written."
        if len(wrong) > 1
        else f"Mesh '{next(iter(wrong))[0]}' was in {unit}: scale {UNITS[unit]:g} written."
    )


def _mend_small_meshes(description: Description) -> None:
    lengths = _mesh_lengths(description)
    if not lengths or max(lengths.values()) > 10 * MIN_MESH_M:
        return
    if np.median(list(lengths.values())) < MIN_MESH_M and _reach(description.urdf) > 0.02:
        _scale_meshes(description, set(lengths), 1e3)
        description.repairs.append("The meshes were scaled down twice: scale made 1000 times more.")


def _mesh_lengths(description: Description) -> dict[tuple[str, tuple[float, ...]], float]:
    """(mesh, scale) -> length of the longest side, metres, for all meshes in use."""
    return {
        (shape.mesh, shape.size): float(
            (description.meshes[shape.mesh].mesh.extents * np.abs(shape.size)).max()
        )
        for link in description.urdf.links.values()
        for shape in (*link.collisions, *link.visuals)
        if shape.kind == "mesh"
    }


def _likely_unit(urdf: Urdf, lengths: list[float]) -> str:
    """The unit in which the meshes have about the size of the distances between joints."""
    offsets = [float(np.linalg.norm(j.T_parent_child[:3, 3])) for j in urdf.joints.values()]
    offsets = [offset for offset in offsets if offset > 1e-3]
    if not offsets:
        return "millimetres"
    expected = MESH_PER_OFFSET * float(np.median(offsets))
    length = float(np.median(lengths))
    return min(UNITS, key=lambda unit: abs(math.log(length * UNITS[unit] / expected)))


def _scale_meshes(
    description: Description, keys: set[tuple[str, tuple[float, ...]]], factor: float
) -> None:
    def change(shape: Shape) -> Shape:
        if shape.kind != "mesh" or (shape.mesh, shape.size) not in keys:
            return shape
        return replace(shape, size=tuple(factor * value for value in shape.size))

    change_shapes(description, change)


def _reach(urdf: Urdf) -> float:
    """Length of the longest chain of joints, in the description's unit."""
    reach = {urdf.root: 0.0}
    for joint in urdf.joints.values():
        offset = float(np.linalg.norm(joint.T_parent_child[:3, 3]))
        reach[joint.child] = reach[joint.parent] + offset
    return max(reach.values())


def _scaled(urdf: Urdf, factor: float) -> Urdf:
    links = {name: _scaled_link(link, factor) for name, link in urdf.links.items()}
    joints = {name: _scaled_joint(joint, factor) for name, joint in urdf.joints.items()}
    return replace(urdf, links=links, joints=joints)


def _scaled_link(link: Link, factor: float) -> Link:
    def scaled(shape: Shape) -> Shape:
        pose = _scaled_pose(shape.T_link_shape, factor)
        size = shape.size
        if shape.kind != "mesh":  # the unit of a mesh's file is found by itself
            size = tuple(factor * value for value in size)
        return replace(shape, size=size, T_link_shape=pose)

    inertial = link.inertial
    if inertial is not None:
        pose = _scaled_pose(inertial.T_link_center, factor)
        inertial = Inertial(inertial.mass, pose, factor**2 * inertial.inertia)
    return replace(
        link,
        collisions=tuple(map(scaled, link.collisions)),
        visuals=tuple(map(scaled, link.visuals)),
        inertial=inertial,
    )


def _scaled_joint(joint: Joint, factor: float) -> Joint:
    pose = _scaled_pose(joint.T_parent_child, factor)
    if joint.type != "prismatic":
        return replace(joint, T_parent_child=pose)
    return replace(
        joint, T_parent_child=pose, lower=factor * joint.lower, upper=factor * joint.upper
    )


def _scaled_pose(pose: np.ndarray, factor: float) -> np.ndarray:
    scaled = pose.copy()
    scaled[:3, 3] *= factor
    return scaled
