"""The bundled hands move like, and look like, the makers' models that they were measured from.

The makers' models aren't ours to ship: without the asset folder (``GDG_TEST_ASSETS``) what compares
with them is skipped.
"""

from __future__ import annotations

import functools
import os
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yourdfpy
from scipy.spatial import cKDTree

from gdg.hands.geometry import ConvexPart
from gdg.hands.hand import Hand, load_hand

ROOT = Path(__file__).resolve().parents[1]
MAKERS = Path(os.environ.get("GDG_TEST_ASSETS", ROOT.parent / "shared" / "assets")) / "hands"
HANDS = ("allegro", "barrett", "ezgripper", "robotiq_3finger", "shadowhand")
needs_makers_models = pytest.mark.skipif(
    not all((MAKERS / hand / f"{hand}.urdf").is_file() for hand in HANDS),
    reason="no asset folder (GDG_TEST_ASSETS)",
)


def _allegro_names() -> tuple[dict[str, str], dict[str, str]]:
    links, joints = {"palm": "base_link"}, {}
    for finger, first in (("index", 0), ("middle", 4), ("ring", 8), ("thumb", 12)):
        thumb = finger == "thumb"
        middle = ("hub", "proximal") if thumb else ("proximal", "middle")
        for offset, part in enumerate(("base", *middle, "distal")):
            links[f"{finger}_{part}"] = f"link_{first + offset}.0"
        links[f"{finger}_tip"] = f"link_{first + 3}.0_tip"
        first_two = ("opposition", "abduction") if thumb else ("abduction", "proximal")
        last_two = ("proximal", "distal") if thumb else ("middle", "distal")
        for offset, part in enumerate(first_two + last_two):
            joints[f"{finger}_{part}"] = f"joint_{first + offset}.0"
    return links, joints


def _barrett_names() -> tuple[dict[str, str], dict[str, str]]:
    links = {"palm": "bh_base_link"}
    joints = {"spread": "bh_j11_joint", "finger_2_spread": "bh_j21_joint"}
    for finger in (1, 2, 3):
        for number, part in enumerate(("base", "proximal", "distal"), start=1):
            links[f"finger_{finger}_{part}"] = f"bh_finger_{finger}{number}_link"
            if part != "base":
                joints[f"finger_{finger}_{part}"] = f"bh_j{finger}{number}_joint"
    return links, joints


def _ezgripper_names() -> tuple[dict[str, str], dict[str, str]]:
    links, joints = {"palm": "left_ezgripper_palm_link"}, {}
    for finger in (1, 2):
        for part, number, ends in (("proximal", 1, "palm_L1"), ("distal", 2, "L1_L2")):
            links[f"finger_{finger}_{part}"] = f"left_ezgripper_finger_L{number}_{finger}"
            joints[f"finger_{finger}_{part}"] = f"left_ezgripper_knuckle_{ends}_{finger}"
    return links, joints


def _robotiq_names() -> tuple[dict[str, str], dict[str, str]]:
    links, joints = {"palm": "gripper_palm"}, {}
    for finger in "abc":
        theirs = f"gripper_finger{finger.upper()}"
        for part, their_part in (("base", "base"), ("proximal", "prox"), ("middle", "med")):
            links[f"finger_{finger}_{part}"] = f"{theirs}_{their_part}"
        links[f"finger_{finger}_distal"] = f"{theirs}_dist"
        for number, part in enumerate(("proximal", "middle", "distal"), start=2):
            joints[f"finger_{finger}_{part}"] = f"{theirs}_joint_{number}"
        if finger != "a":
            joints[f"finger_{finger}_knuckle"] = f"{theirs}_knuckle"
    return links, joints


def _shadowhand_names() -> tuple[dict[str, str], dict[str, str]]:
    """The maker's own names: every description of this hand uses them."""
    links, joints = ["forearm", "wrist", "palm", "lfmetacarpal"], ["WRJ2", "WRJ1", "LFJ5"]
    for finger in ("ff", "mf", "rf", "lf"):
        links += [f"{finger}{part}" for part in ("knuckle", "proximal", "middle", "distal")]
        joints += [f"{finger.upper()}J{number}" for number in (4, 3, 2, 1)]
    links += [f"th{part}" for part in ("base", "proximal", "hub", "middle", "distal")]
    joints += [f"THJ{number}" for number in (5, 4, 3, 2, 1)]
    return dict(zip(links, links)), dict(zip(joints, joints))


#: Our names -> the maker's: links, joints.
NAMES = {
    "allegro": _allegro_names(),
    "barrett": _barrett_names(),
    "ezgripper": _ezgripper_names(),
    "robotiq_3finger": _robotiq_names(),
    "shadowhand": _shadowhand_names(),
}
#: Links whose outline differs from all that come before, and so is worth measuring.
SHAPES = {
    "allegro": (
        "palm", "index_base", "index_proximal", "index_middle", "index_distal", "index_tip",
        "thumb_base", "thumb_hub", "thumb_proximal", "thumb_distal",
    ),
    "barrett": (
        "palm", "finger_1_base", "finger_3_base", "finger_1_proximal", "finger_1_distal",
    ),
    "ezgripper": ("palm", "finger_1_proximal", "finger_1_distal"),
    "robotiq_3finger": (
        "palm", "finger_a_base", "finger_a_proximal", "finger_a_middle", "finger_a_distal",
    ),
    "shadowhand": (
        "forearm", "wrist", "palm", "lfmetacarpal", "ffknuckle", "lfknuckle", "ffproximal",
        "ffmiddle", "ffdistal", "mfdistal", "thproximal", "thmiddle", "thdistal",
    ),
}  # fmt: skip
MEAN_LIMIT_MM = 3.0
P95_LIMIT_MM = 8.0


@functools.cache
def _ours(hand: str) -> Hand:
    return load_hand(ROOT / "hands" / hand)


def _urdf(path: Path, **options: bool) -> yourdfpy.URDF:
    return yourdfpy.URDF.load(str(path), build_collision_scene_graph=False, **options)


@needs_makers_models
@pytest.mark.parametrize("name", HANDS)
def test_joint_limits_equal_the_makers(name: str):
    theirs = _urdf(MAKERS / name / f"{name}.urdf", load_meshes=False).joint_map
    for joint, their_joint in NAMES[name][1].items():
        ours, limit = _ours(name).urdf.joints[joint], theirs[their_joint].limit
        assert (ours.lower, ours.upper) == pytest.approx((limit.lower, limit.upper), abs=1e-6)


@needs_makers_models
@pytest.mark.parametrize("name", HANDS)
def test_every_link_moves_like_the_makers(name: str):
    links, joints = NAMES[name]
    spec = _ours(name).spec
    ours = _urdf(ROOT / "hands" / name / spec.urdf, load_meshes=False)
    theirs = _urdf(MAKERS / name / f"{name}.urdf", load_meshes=False)
    rng, (lower, upper) = np.random.default_rng(0), _ours(name).limits()
    for _ in range(20):
        values = rng.uniform(lower, upper)
        ours.update_cfg(dict(zip(spec.joints, values)))
        theirs.update_cfg({joints[j]: value for j, value in zip(spec.joints, values)})
        for link, their_link in links.items():
            T_root_ours = ours.get_transform(link, spec.root_link)
            T_root_theirs = theirs.get_transform(their_link, theirs.base_link)
            offset = np.linalg.norm(T_root_ours[:3, 3] - T_root_theirs[:3, 3])
            cosine = (np.trace(T_root_ours[:3, :3].T @ T_root_theirs[:3, :3]) - 1) / 2
            assert offset < 1e-3, link
            assert np.degrees(np.arccos(np.clip(cosine, -1, 1))) < 1.0, link


@needs_makers_models
@pytest.mark.parametrize(("name", "link"), [(n, link) for n in HANDS for link in SHAPES[n]])
def test_outline_is_close_to_the_makers(name: str, link: str, record_property):
    mean_there, p95_there, mean_back, p95_back = outline_distances(name, link)
    record_property("mesh_to_primitives_mm", f"mean {mean_there:.2f}, p95 {p95_there:.2f}")
    record_property("primitives_to_mesh_mm", f"mean {mean_back:.2f}, p95 {p95_back:.2f}")
    assert max(mean_there, mean_back) < MEAN_LIMIT_MM
    assert max(p95_there, p95_back) < P95_LIMIT_MM


@pytest.mark.parametrize("name", HANDS)
def test_contact_regions_lie_on_the_surface_and_face_outward(name: str):
    hand = _ours(name)
    for link, regions in hand.spec.contact_regions.items():
        parts = [part for part in hand.parts if part.link == link]
        for region in regions:
            corners = np.array(region)
            normal = np.cross(corners[2] - corners[0], corners[3] - corners[1])
            normal /= np.linalg.norm(normal)
            points = _points_of(corners)
            assert np.abs(_signed_distance(parts, points)).max() < 1e-3, link
            assert _signed_distance(parts, points + 0.003 * normal).min() > 1e-3, link


def test_hands_weigh_what_their_readmes_say():
    for name, kilograms in (
        ("allegro", 0.96),
        ("barrett", 0.925),
        ("ezgripper", 0.4),
        ("robotiq_3finger", 2.3),
        ("shadowhand", 3.79),
    ):
        robot = _urdf(ROOT / "hands" / name / f"{name}.urdf", load_meshes=False).robot
        assert sum(link.inertial.mass for link in robot.links) == pytest.approx(kilograms, abs=0.01)


def outline_distances(name: str, link: str, count: int = 20_000) -> tuple[float, ...]:
    """Mesh to primitives (mean, 95th percentile), then primitives to mesh; millimetres.

    Of both surfaces only what can be seen from outside counts.
    """
    their_link = NAMES[name][0][link]
    mesh = _makers_mesh(name, their_link)
    points, face = trimesh.sample.sample_surface(mesh, 2 * count, seed=1)
    theirs = points[_visible(points, mesh.face_normals[face])]
    ours = _outside(
        [part for part in _ours(name).parts if part.link == link],
        count,
    )
    there, back = cKDTree(ours).query(theirs)[0], cKDTree(theirs).query(ours)[0]
    return tuple(1e3 * float(f) for d in (there, back) for f in (d.mean(), np.percentile(d, 95)))


def _makers_mesh(name: str, link: str) -> trimesh.Trimesh:
    visual = _urdf(MAKERS / name / f"{name}.urdf", load_meshes=False).link_map[link].visuals[0]
    mesh = trimesh.load_mesh(MAKERS / name / visual.geometry.mesh.filename)
    return mesh.apply_transform(np.eye(4) if visual.origin is None else visual.origin)


def _visible(points: np.ndarray, normals: np.ndarray, pixel_m: float = 0.003) -> np.ndarray:
    """Which points the depth images from 42 directions show (a mesh has inner faces, too)."""
    seen = np.zeros(len(points), bool)
    for direction in trimesh.creation.icosphere(subdivisions=1).vertices:
        across = np.linalg.svd(direction[None])[2][1:]
        pixel = np.floor(points @ across.T / pixel_m).astype(int)
        pixel -= pixel.min(0)
        index = pixel[:, 0] * (pixel[:, 1].max() + 1) + pixel[:, 1]
        depth = points @ direction
        nearest = np.full(index.max() + 1, -np.inf)
        np.maximum.at(nearest, index, depth)
        seen |= (depth >= nearest[index] - pixel_m) & (normals @ direction > 0.2)
    return seen


def _outside(parts: list[ConvexPart], count: int) -> np.ndarray:
    """Points on the union of a link's parts."""
    areas, points = np.array([part.mesh.area for part in parts]), []
    for i, part in enumerate(parts):
        share = int(np.ceil(count * areas[i] / areas.sum()))
        on_part = trimesh.sample.sample_surface(part.mesh, share, seed=i)[0]
        others = parts[:i] + parts[i + 1 :]
        if others:
            on_part = on_part[_signed_distance(others, on_part) > -1e-7]
        points.append(on_part)
    return np.concatenate(points)


def _signed_distance(parts: list[ConvexPart], points: np.ndarray) -> np.ndarray:
    """Negative inside; the largest distance to a face plane, so never above the true distance."""
    each = []
    for part in parts:
        normals = part.mesh.face_normals
        offsets = np.einsum("ij,ij->i", normals, part.mesh.triangles[:, 0])
        each.append((points @ normals.T - offsets).max(-1))
    return np.min(each, axis=0)


def _points_of(corners: np.ndarray, steps: int = 7) -> np.ndarray:
    u, v = (t.ravel()[:, None] for t in np.meshgrid(*[np.linspace(0, 1, steps)] * 2))
    lower = (1 - u) * corners[0] + u * corners[1]
    upper = (1 - u) * corners[3] + u * corners[2]
    return (1 - v) * lower + v * upper
