"""Writes the bundled objects: ``python tools/make_objects.py [--out objects] [name ...]``.

Every object is our own watertight model, built from published dimensions and simple profiles.
Lengths in the recipes are millimetres; the written meshes are in metres, z up, with the area
centroid of the surface at the origin. Running it twice writes the same bytes. The shapes need
manifold3d for their booleans.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import trimesh
import yaml
from mesh_shapes import (
    ball,
    curve,
    difference,
    lathe,
    placed,
    polyline,
    rounded_box,
    squared,
    sweep,
    union,
    warped,
)

from gdg.objects.spec import MANIFEST, ObjectSpec

YCB = "(YCB object set, Calli et al. 2015)"
CONTACTDB = "(overall size of the ContactDB object, Brahmbhatt et al. 2019)"


def cube(side: float) -> trimesh.Trimesh:
    """A cube with slightly rounded edges."""
    return rounded_box((side, side, side), edge=side / 14)


def cylinder(diameter: float, height: float, edge: float = 4) -> trimesh.Trimesh:
    """An upright cylinder with slightly rounded rims."""
    r = diameter / 2
    profile = polyline((0, 0), (r, 0, 2), (r, height, 2), (0, height), edge=edge)
    return lathe(profile, edge)


def pyramid(side: float) -> trimesh.Trimesh:
    """A square pyramid as tall as its base is wide."""
    h = side / 2
    corners = [(h, h, 0), (-h, h, 0), (-h, -h, 0), (h, -h, 0), (0, 0, side)]
    faces = [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4), (0, 2, 1), (0, 3, 2)]
    return trimesh.Trimesh(corners, faces).subdivide(iterations=4)


def torus() -> trimesh.Trimesh:
    """A ring of 80 mm with a round section of 26.5 mm."""
    return trimesh.creation.torus(26.75, 13.25, major_sections=52, minor_sections=26)


def orange() -> trimesh.Trimesh:
    """A sphere, slightly flat, with a dimple at the stem."""
    return lathe(
        curve((0, 0), (19, 4.5), (33, 19), (36.5, 35), (33, 52), (19, 66.5), (5, 70.5), (0, 69.5))
    )


def lemon() -> trimesh.Trimesh:
    """A spindle that lies along x, with a nipple at one end."""
    outline = [(0, 0), (6, 1.5), (16, 8), (24.5, 20), (27, 33), (24, 46), (16, 56.5), (8, 63)]
    return placed(lathe(curve(*outline, (5, 66.5), (0, 68))), turn="y", degrees=90)


def peach() -> trimesh.Trimesh:
    """Nearly a sphere, dimpled at the stem and with a crease down one side."""
    body = lathe(
        curve((0, 0), (14, 3), (26, 14), (29.5, 29), (26, 44), (14, 55), (6, 56), (0, 51)), 3
    )

    def crease(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, ...]:
        scale = 1 - 0.07 * np.exp(-((np.arctan2(y, x) / 0.22) ** 2))
        return x * scale, y * scale, z

    return warped(body, crease)


def strawberry() -> trimesh.Trimesh:
    """A rounded cone, tip down."""
    outline = [(0, 0), (7, 3), (14, 15), (20, 31), (21.9, 42), (17, 52), (8, 55), (0, 53)]
    return lathe(curve(*outline, edge=3), 3)


def banana() -> trimesh.Trimesh:
    """A bent, faintly five-sided tube with a stalk; lies in the x-z plane."""
    angle = np.linspace(-0.93, 0.93, 50)
    path = 114 * np.column_stack([np.sin(angle), 1 - np.cos(angle)])
    knots = [0, 0.03, 0.1, 0.25, 0.5, 0.75, 0.88, 0.93, 0.96, 1]
    radii = np.interp(
        np.linspace(0, 1, len(path)), knots, [4, 6, 11, 15.8, 18.5, 15.8, 10, 6, 4.5, 5]
    )
    smooth = np.convolve(np.pad(radii, 2, mode="edge"), np.full(5, 0.2), mode="valid")
    return sweep(path, smooth)


def apple() -> trimesh.Trimesh:
    """Dimpled at both ends, with a stem."""
    outline = [(0, 6), (7, 2), (18, 0.5), (30, 13), (37.5, 38), (33, 57), (20, 67), (9, 65)]
    stem = lathe(polyline((0, 54), (1.8, 54), (1.8, 75), (0, 75)))
    return union(lathe(curve(*outline, (0, 58))), placed(stem, (-6, 0, 0), "y", 6))


def pear() -> trimesh.Trimesh:
    """A bulb that narrows into a neck, with a stem."""
    outline = [(0, 3), (9, 0.5), (23, 7), (32, 22), (33, 33), (26, 52), (18, 67), (14, 80)]
    stem = lathe(polyline((0, 80), (2, 80), (2, 100), (0, 100)))
    return union(lathe(curve(*outline, (8, 89), (0, 91))), stem)


def can(diameter: float, height: float, edge: float = 4) -> trimesh.Trimesh:
    """A tin can: ends recessed behind the seams."""
    r, h = diameter / 2, height
    half = [(0, 2), (r - 4, 2), (r - 3, 0), (r, 0, 1), (r, 4), (r - 1, 6)]
    other = [(x, h - z, *cut) for x, z, *cut in reversed(half)]
    return lathe(polyline(*half, *other, edge=edge), edge)


def potted_meat_can() -> trimesh.Trimesh:
    """A tin with a rounded rectangular section."""
    return warped(squared(can(97, 82, 5), 4.5), lambda x, y, z: (x, y * 50 / 97, z))


def mustard_bottle() -> trimesh.Trimesh:
    """An oval squeeze bottle with sloping shoulders and a pointed cap."""
    body = polyline(
        (0, 0), (47.5, 0, 7), (45, 60, 30), (48.5, 112, 18), (36, 146, 13), (19, 152, 3),
        (19, 167, 3), (8, 170, 4), (5, 190, 1.5), (0, 190), edge=5,
    )  # fmt: skip

    def flatten(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, ...]:
        return x, y * np.interp(z, [0, 132, 152], [0.61, 0.61, 1]), z

    return warped(lathe(body, 5), flatten)


def toothpaste() -> trimesh.Trimesh:
    """A tube that flattens towards the crimp, standing on its cap."""
    profile = polyline(
        (0, 0), (15, 0, 2), (17, 22, 1.5), (13, 24), (13, 27), (19, 33, 2), (26.3, 202), (0, 202)
    )

    def flatten(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, ...]:
        return x, y * np.interp(z, [0, 45, 190, 202], [1, 1, 0.1, 0.1]), z

    return warped(lathe(profile, 5), flatten)


def water_bottle() -> trimesh.Trimesh:
    """A half-litre bottle with a waist, a domed shoulder and a cap."""
    profile = polyline(
        (0, 4), (14, 4), (24, 0, 2.5), (32.5, 0, 6), (32.5, 60, 10), (28, 85, 13), (32.5, 110, 10),
        (32.5, 140, 18), (13, 181, 4), (13, 187), (16.5, 187), (16.5, 190), (15, 190),
        (15, 205, 1.5), (0, 205), edge=4.5,
    )  # fmt: skip
    return lathe(profile, 4.5)


def light_bulb() -> trimesh.Trimesh:
    """A pear-shaped bulb standing on its screw cap."""
    cap = polyline((0, 0), (5, 0), (7, 4), (12, 7), (13.2, 10), (13.2, 27), edge=3)
    glass = curve(
        (13.2, 27), (16, 38), (23, 52), (29, 67), (30, 81), (26, 96), (16, 106.5), (0, 110)
    )
    return lathe(np.concatenate([cap, glass[1:]]), 3.5)


def flashlight() -> trimesh.Trimesh:
    """A torch standing on its tail, with a recessed lens in a wider head."""
    profile = polyline(
        (0, 0), (12, 0, 3), (12, 90, 3), (17.4, 106, 4), (17.4, 139, 1), (15, 139), (14, 134),
        (0, 134), edge=3,
    )  # fmt: skip
    return lathe(profile, 3)


def door_knob() -> trimesh.Trimesh:
    """A round knob on a neck and a rose, as if the door lay flat."""
    rose = polyline((0, 0), (33.5, 0), (33.5, 5, 3), (22, 9, 4), (12, 12, 3), (11, 24))
    knob = curve((11, 24), (15, 31), (24, 39), (27, 48), (22, 58), (10, 61.5), (0, 62))
    return lathe(np.vstack([rose, knob[1:]]))


def hammer() -> trimesh.Trimesh:
    """A claw hammer lying flat: handle along x, head along y."""
    grip = curve((13, -106), (15, -88), (13, -40), (11, 0), (10, 40), (9, 85))
    handle = lathe(np.vstack([(0, -106), (7, -106), grip, (0, 85)]))
    handle = warped(handle, lambda x, y, z: (x, y * 0.75, z))
    face = polyline(
        (0, -52), (11.5, -52, 1.5), (11.5, -40, 2), (8, -34, 2), (8, -22, 2), (10, -14), (10, 16),
        (0, 16),
    )  # fmt: skip
    arc = np.radians(np.linspace(0, 62, 14))
    claw = sweep(
        np.column_stack([60 * np.sin(arc) + 8, 60 * np.cos(arc) - 60]), np.linspace(10, 5, 14)
    )
    slot = placed(rounded_box((60, 3, 60), 1), (66, 0, -30))
    head = union(placed(lathe(face, 3.5), turn="y", degrees=90), difference(claw, slot))
    upright = union(handle, placed(head, (0, 0, 88)))
    return placed(placed(upright, turn="y", degrees=90), turn="x", degrees=90)


def stapler() -> trimesh.Trimesh:
    """A base, a raised arm and the hinge between them."""
    base = placed(rounded_box((123, 30, 9), 3), (0, 0, 4.5))
    arm = placed(rounded_box((116, 26, 15), 5), (2, 0, 25), "y", -6)
    magazine = placed(rounded_box((104, 17, 9), 2), (4, 0, 16), "y", -6)
    hinge = placed(rounded_box((28, 22, 26), 4), (-44, 0, 16))
    return union(base, arm, magazine, hinge)


def mouse() -> trimesh.Trimesh:
    """A computer mouse: a smooth hump on a flat oval, highest behind the middle."""
    dome = polyline((0, 0), (30, 0, 2), (31.6, 12, 5), (27, 34, 16), (0, 39))
    body = squared(lathe(dome), 2.6)

    def stretch(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, ...]:
        return x * 116.5 / 62, y, z * (1 - 0.4 * np.clip((x + 8) / 40, 0, 1) ** 2)

    return warped(body, stretch)


def camera() -> trimesh.Trimesh:
    """A compact camera: body, lens barrel facing -y, viewfinder hump, dial and release."""
    body = rounded_box((109, 32, 70), 5)
    barrel = lathe(
        polyline((0, 0), (26, 0), (26, 12, 1), (22, 12.5), (22, 20, 1), (18, 20), (17, 17), (0, 17))
    )
    lens = placed(barrel, (8, -10, -3), "x", 90)
    hump = placed(rounded_box((34, 26, 17), 4), (8, 0, 34.5))
    dial = placed(cylinder(20, 9, 3), (-18, 1, 32))
    release = placed(cylinder(11, 9, 3), (-40, -2, 31))
    return union(body, lens, hump, dial, release)


def rubber_duck() -> trimesh.Trimesh:
    """A bath duck: body, upturned tail, head and beak; looks along +x."""
    body = warped(ball(1), lambda x, y, z: (80 * x, 67 * y, 58 * z + 29))
    tail = warped(ball(1), lambda x, y, z: (34 * x, 34 * y, 16 * z))
    beak = warped(ball(1), lambda x, y, z: (24 * x, 22 * y, 9 * z))
    flat = placed(rounded_box((120, 120, 20)), (0, 0, -6))
    duck = union(
        body,
        placed(tail, (-32, 0, 45), "y", 38),
        placed(ball(48), (13, 0, 76)),
        placed(beak, (35, 0, 73)),
    )
    return difference(duck, flat)


def cup() -> trimesh.Trimesh:
    """A tapered tumbler with a wall of 2.5 mm."""
    profile = polyline(
        (0, 0), (29, 0, 3), (40, 95, 0.8), (37.5, 95, 0.8), (26.8, 3.5, 3), (0, 3.5), edge=4.5
    )
    return lathe(profile, 4.5)


def bowl() -> trimesh.Trimesh:
    """A cereal bowl on a flat base with a wall of 3 mm."""
    outside = curve((30, 0), (48, 7), (65, 23), (74, 38), (79.5, 53), edge=5)
    inside = curve((76.5, 53), (71, 39), (62.5, 25.4), (46.3, 9.8), (29, 3), edge=5)
    return lathe(np.vstack([polyline((0, 0), (30, 0), edge=5), outside[1:], inside,
                            polyline((29, 3), (0, 3), edge=5)[1:]]), 5)  # fmt: skip


def wine_glass() -> trimesh.Trimesh:
    """Foot, stem and a bowl with a wall of 2.5 mm."""
    foot = polyline((0, 0), (34, 0), (34, 2.5, 1), (9, 5, 4), (4.5, 14, 4), (4.5, 52), edge=5)
    outside = curve((4.5, 52), (18, 57), (36, 73), (44.5, 95), (42, 118), (37, 137), edge=5)
    inside = curve((34.5, 137), (39.5, 118), (42, 95), (34, 75), (17, 60), (0, 55.5), edge=5)
    return lathe(np.vstack([foot, outside[1:], inside]), 5)


def mug() -> trimesh.Trimesh:
    """A straight mug with a wall of 3.5 mm and a D-shaped handle along +x."""
    outside = lathe(polyline((0, 0), (40, 0, 3), (40, 82, 1.7), (0, 82), edge=5), 5)
    cavity = lathe(polyline((0, 4.5), (36.5, 4.5, 4), (36.5, 90), (0, 90), edge=5), 5)
    angle = np.radians(np.linspace(-100, 100, 36))
    arc = np.column_stack([40 + 25 * np.cos(angle), 42 + 26 * np.sin(angle)])
    return difference(union(outside, sweep(arc, 4.5, 1.5)), cavity)


@dataclass(frozen=True)
class Recipe:
    """One bundled object: what its manifest says and how its mesh (mm) is built."""

    name: str
    title: str
    split: Literal["train", "test"]
    build: Callable[[], trimesh.Trimesh]
    source: str
    thin_shell_mm: float | None = None


# An object of a kind that the GenDexGrasp paper tests on is a test object here too.
RECIPES = (
    Recipe("cube_small", "Small cube", "train", lambda: cube(40), f"40 mm {CONTACTDB}"),
    Recipe("cube_medium", "Medium cube", "train", lambda: cube(80), f"80 mm {CONTACTDB}"),
    Recipe("cylinder_small", "Small cylinder", "train", lambda: cylinder(40, 40, 2.5),
           f"40 x 40 mm {CONTACTDB}"),
    Recipe("cylinder_medium", "Medium cylinder", "test", lambda: cylinder(80, 80),
           f"80 x 80 mm {CONTACTDB}"),
    Recipe("pyramid_medium", "Medium pyramid", "train", lambda: pyramid(80),
           f"80 x 80 x 80 mm {CONTACTDB}"),
    Recipe("torus_medium", "Medium ring", "train", torus, f"80 x 26.5 mm {CONTACTDB}"),
    Recipe("orange", "Orange", "train", orange, f"017 orange: 73 mm {YCB}"),
    Recipe("lemon", "Lemon", "train", lemon, f"014 lemon: 54 x 68 mm {YCB}"),
    Recipe("peach", "Peach", "train", peach, f"015 peach: 59 mm {YCB}"),
    Recipe("strawberry", "Strawberry", "train", strawberry, f"012 strawberry: 43.8 x 55 mm {YCB}"),
    Recipe("banana", "Banana", "train", banana, f"011 banana: 36 x 190 mm {YCB}"),
    Recipe("apple", "Apple", "test", apple, f"013 apple: 75 mm {YCB}"),
    Recipe("pear", "Pear", "test", pear, f"016 pear: 66.2 x 100 mm {YCB}"),
    Recipe("tennis_ball", "Tennis ball", "train", lambda: ball(67),
           "67 mm, the middle of the 65.4 to 68.6 mm of the ITF rules of tennis"),
    Recipe("baseball", "Baseball", "test", lambda: ball(73.7),
           "73.7 mm, from the 9 to 9 1/4 in circumference of the Official Baseball Rules"),
    Recipe("tuna_fish_can", "Tuna can", "train", lambda: can(85, 33),
           f"007 tuna fish can: 85 x 33 mm {YCB}"),
    Recipe("tomato_soup_can", "Soup can", "test", lambda: can(66, 101),
           f"005 tomato soup can: 66 x 101 mm {YCB}"),
    Recipe("potted_meat_can", "Potted meat can", "test", potted_meat_can,
           f"010 potted meat can: 50 x 97 x 82 mm {YCB}"),
    Recipe("cracker_box", "Cracker box", "train", lambda: rounded_box((60, 158, 210), edge=8),
           f"003 cracker box: 60 x 158 x 210 mm {YCB}"),
    Recipe("sugar_box", "Sugar box", "train", lambda: rounded_box((38, 89, 175), edge=6),
           f"004 sugar box: 38 x 89 x 175 mm {YCB}"),
    Recipe("foam_brick", "Foam brick", "train", lambda: rounded_box((50, 75, 50), 4),
           f"061 foam brick: 50 x 75 x 50 mm {YCB}"),
    Recipe("mustard_bottle", "Mustard bottle", "train", mustard_bottle,
           f"006 mustard bottle: 58 x 95 x 190 mm {YCB}"),
    Recipe("water_bottle", "Water bottle", "test", water_bottle,
           "own profile of a 500 ml PET bottle, 65 x 205 mm, neck after the 28 mm PCO 1881 finish"),
    Recipe("toothpaste", "Toothpaste tube", "train", toothpaste, f"202 x 53 x 38 mm {CONTACTDB}"),
    Recipe("light_bulb", "Light bulb", "train", light_bulb,
           "bulb shape A60 with an E27 cap: 60 x 110 mm (IEC 60064)"),
    Recipe("flashlight", "Flashlight", "train", flashlight, f"35 x 139 mm {CONTACTDB}"),
    Recipe("door_knob", "Door knob", "test", door_knob,
           "own profile of a 54 mm knob, 62 mm projection, 67 mm rose over a 2 1/8 in bore"),
    Recipe("hammer", "Claw hammer", "train", hammer, f"205 x 117 x 23 mm {CONTACTDB}"),
    Recipe("stapler", "Stapler", "train", stapler, f"123 x 30 x 40 mm {CONTACTDB}"),
    Recipe("mouse", "Computer mouse", "train", mouse, f"117 x 62 x 39 mm {CONTACTDB}"),
    Recipe("camera", "Compact camera", "test", camera,
           "own design at the published size of a Canon PowerShot G10: 109 x 78 x 46 mm"),
    Recipe("rubber_duck", "Rubber duck", "test", rubber_duck, f"91 x 67 x 96 mm {CONTACTDB}"),
    Recipe("cup", "Tumbler", "train", cup, "own profile of a 0.3 l tumbler: 80 x 95 mm", 2.5),
    Recipe("bowl", "Bowl", "train", bowl, f"024 bowl: 159 x 53 mm {YCB}", 3),
    Recipe("wine_glass", "Wine glass", "train", wine_glass,
           f"023 wine glass: 89 x 137 mm {YCB}", 2.5),
    Recipe("mug", "Mug", "test", mug, f"025 mug: 80 x 82 mm {YCB}", 3.5),
)  # fmt: skip


def canonical(mesh_mm: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh in metres, centred, on a grid of 1 µm, vertices and faces in sorted order.

    Grid and order hide what depends on the machine: the last bits of floating-point numbers and
    the order in which a boolean emits its triangles.
    """
    micrometres = np.round((mesh_mm.vertices - mesh_mm.centroid) * 1000)
    vertices, index = np.unique(micrometres, axis=0, return_inverse=True)
    faces = index.reshape(-1)[mesh_mm.faces]
    faces = faces[[len(set(face)) == 3 for face in faces.tolist()]]
    first = faces.argmin(axis=1)[:, None]
    faces = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    return trimesh.Trimesh(vertices / 1e6, faces[np.lexsort(faces.T[::-1])], process=False)


def write(recipe: Recipe, out: Path) -> trimesh.Trimesh:
    """Writes ``out/<name>`` and returns the mesh, in metres.

    Raises:
        ValueError: the recipe doesn't give one closed body.
    """
    mesh = canonical(recipe.build())
    if not mesh.is_volume or mesh.body_count != 1:
        raise ValueError(f"{recipe.name}: not one closed body with outward faces")
    wall = None if recipe.thin_shell_mm is None else recipe.thin_shell_mm / 1000
    spec = ObjectSpec(
        name=recipe.name, title=recipe.title, mesh=f"{recipe.name}.stl", split=recipe.split,
        thin_shell=wall, source=recipe.source, licence="Apache-2.0",
    )  # fmt: skip
    folder = out / recipe.name
    folder.mkdir(parents=True, exist_ok=True)
    tree = spec.model_dump(exclude_none=True)
    text = yaml.safe_dump(tree, sort_keys=False, width=100, allow_unicode=True)
    (folder / MANIFEST).write_text(text, encoding="utf-8", newline="\n")
    data = mesh.export(file_type="stl")
    assert isinstance(data, bytes)
    (folder / spec.mesh).write_bytes(data)
    return mesh


def write_table(meshes: Iterable[tuple[Recipe, trimesh.Trimesh]], out: Path) -> None:
    """Writes ``out/README.md``: one line per object."""
    lines = [
        "# Bundled objects",
        "",
        "Our own watertight models, in metres, z up, area centroid at the origin; written by",
        "`python tools/make_objects.py`. Edit the recipes there, not these files. An object of a",
        "kind that the GenDexGrasp paper tests on is a test object here too.",
        "",
        "| name | split | extents, mm | volume, cm³ | wall, mm | faces | dimensions from |",
        "|---|---|---|---:|---:|---:|---|",
    ]
    for recipe, mesh in meshes:
        extents = " x ".join(f"{side:.0f}" for side in mesh.extents * 1000)
        lines.append(
            f"| {recipe.name} | {recipe.split} | {extents} | {mesh.volume * 1e6:.0f} "
            f"| {recipe.thin_shell_mm or ''} | {len(mesh.faces)} | {recipe.source} |"
        )
    text = "\n".join(lines) + "\n"
    (out / "README.md").write_text(text, encoding="utf-8", newline="\n")


def main() -> None:
    """Writes the named objects, or all of them and the table."""
    parser = argparse.ArgumentParser(description="Write the bundled objects.")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent.parent / "objects")
    parser.add_argument("names", nargs="*", metavar="name", help="default: all, and the table")
    options = parser.parse_args()
    known = {recipe.name: recipe for recipe in RECIPES}
    if unknown := sorted(set(options.names) - set(known)):
        parser.error(f"unknown: {', '.join(unknown)}; known: {', '.join(known)}")
    chosen = [known[name] for name in options.names] or RECIPES
    meshes = [(recipe, write(recipe, options.out)) for recipe in chosen]
    if not options.names:
        write_table(meshes, options.out)


if __name__ == "__main__":
    main()
