"""Draws docs/images/thin-shell.png: what a fingertip on a thin wall looks like to two distances.

A fingertip touches a tumbler with walls of 2.5 mm, once from outside and once from inside. The
aligned distance lights up the touched side only; the Euclidean one, blind to the side of the
surface, lights up both, as if the tumbler were held from outside and inside at once::

    python docs/figures/thin_shell.py
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import trimesh
from PIL import Image, ImageDraw, ImageFont

from gdg.objects.model import find_object
from gdg.registry import get_registry
from gdg.report.meshes import PictureMesh, object_mesh
from gdg.report.palette import HAND, OBJECT_PLAIN, contact_colors, unit_rgb
from gdg.report.render import Renderer

OUT = Path(__file__).resolve().parents[1] / "images" / "thin-shell.png"
#: Fine enough that the picture shows the distance, not its sampling: a vertex every 0.6 mm.
MAX_FACES = 150_000
FINGER_RADIUS_M, FINGER_LENGTH_M = 0.008, 0.022
#: The finger is drawn this far off the wall, so that it doesn't hide what it touches.
LIFT_M = 0.014
#: Height of the touched spot, as a share of the tumbler's.
HEIGHT_SHARE = 0.6
DISTANCES = {
    "aligned": "only the touched side lights up",
    "euclidean": "both sides of the wall light up",
}
#: Eyes (azimuth from the touched spot, elevation) in degrees.
OUTER_EYE, INNER_EYE = (38.0, 14.0), (152.0, 47.0)

VIEW, LABEL_PX, HEADER_PX, GAP_PX = (380, 380), 172, 74, 14
PAPER, CARD, LINE = (246, 247, 249), (255, 255, 255), (226, 229, 234)
INK, FAINT = (31, 35, 40), (101, 109, 118)


@dataclass(frozen=True)
class Touch:
    """A fingertip that touches the wall: its spot (3,) and the wall's outward normal there (3,)."""

    title: str
    spot: np.ndarray
    normal: np.ndarray

    def finger(self, lift: float) -> trimesh.Trimesh:
        """A capsule that stands on the wall, ``lift`` metres off it."""
        capsule = trimesh.creation.capsule(FINGER_LENGTH_M, FINGER_RADIUS_M, count=[48, 48])
        capsule.apply_translation((0.0, 0.0, lift - capsule.bounds[0, 2]))
        capsule.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], self.normal))
        return capsule.apply_translation(self.spot)

    def contact_map(self, distance: str, wall: PictureMesh) -> np.ndarray:
        """Contact values at the wall's vertices, (vertex,)."""
        record = get_registry().find("distance", distance)
        metric = record.load()(record.options())
        points, _ = trimesh.sample.sample_surface_even(self.finger(0.0), 3000, seed=0)
        hand = torch.as_tensor(np.vstack((points, self.spot)), dtype=torch.float32)
        to_hand = metric.to_hand(
            torch.from_numpy(wall.vertices), torch.from_numpy(wall.normals), hand[None]
        )
        return metric.contact_value(to_hand.distance)[0].numpy()


def touches(wall: PictureMesh) -> list[Touch]:
    """From outside and from inside, at the same place of the wall, on the +x side."""
    low, high = wall.vertices[:, 2].min(), wall.vertices[:, 2].max()
    aim = np.array([wall.vertices[:, 0].max(), 0.0, low + HEIGHT_SHARE * (high - low)])
    found = []
    for title, side in (("Touched from outside", 1.0), ("Touched from inside", -1.0)):
        faces_side = side * wall.normals[:, 0] > 0.9
        gap = np.linalg.norm(wall.vertices - aim, axis=-1) + np.where(faces_side, 0.0, 1.0)
        nearest = int(gap.argmin())
        found.append(Touch(title, wall.vertices[nearest], wall.normals[nearest]))
    return found


def eye_direction(azimuth_deg: float, elevation_deg: float) -> np.ndarray:
    """Unit vector towards the viewer."""
    azimuth, elevation = np.radians((azimuth_deg, elevation_deg))
    flat = np.cos(elevation)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


def render(wall: PictureMesh, touch: Touch, values: np.ndarray) -> list[Image.Image]:
    """The outer and the inner side of the wall, coloured by contact value."""
    finger = object_mesh(touch.finger(LIFT_M), 20_000)
    with closing(Renderer(*VIEW, background=unit_rgb(CARD))) as renderer:
        renderer.add(wall, unit_rgb(OBJECT_PLAIN), shine=0.05).paint(contact_colors(values))
        renderer.add(finger, unit_rgb(HAND), shine=0.25)
        shown = np.vstack((wall.vertices, finger.vertices))
        return [renderer.picture(eye_direction(*eye), shown) for eye in (OUTER_EYE, INNER_EYE)]


def text(draw: ImageDraw.ImageDraw, place: tuple[float, float], line: str, **style: object) -> None:
    size = int(style.pop("size", 14))  # type: ignore[call-overload]
    draw.text(place, line, font=ImageFont.load_default(size), **style)  # type: ignore[arg-type]


def compose(cells: dict[str, list[Image.Image]], titles: list[str]) -> Image.Image:
    """One row per distance; columns: each touch seen from the outer and the inner side."""
    step = VIEW[0] + GAP_PX
    width = LABEL_PX + 4 * step
    picture = Image.new("RGB", (width, HEADER_PX + len(cells) * (VIEW[1] + GAP_PX)), PAPER)
    draw = ImageDraw.Draw(picture)
    for index, title in enumerate(titles):
        left = LABEL_PX + 2 * index * step
        text(draw, (left + step - GAP_PX / 2, 24), title, size=20, fill=INK, anchor="mm")
        for side, name in enumerate(("outer side of the wall", "inner side of the wall")):
            middle = left + side * step + VIEW[0] / 2
            text(draw, (middle, 54), name, size=15, fill=FAINT, anchor="mm")
    for row, (distance, pictures) in enumerate(cells.items()):
        top = HEADER_PX + row * (VIEW[1] + GAP_PX)
        _label(draw, distance, top + VIEW[1] / 2)
        for column, cell in enumerate(pictures):
            left = LABEL_PX + column * step
            picture.paste(cell, (left, top))
            draw.rectangle((left, top, left + VIEW[0] - 1, top + VIEW[1] - 1), outline=LINE)
    return picture


def _label(draw: ImageDraw.ImageDraw, distance: str, middle: float) -> None:
    text(draw, (GAP_PX, middle - 34), distance, size=20, fill=INK, anchor="lm")
    words = DISTANCES[distance].split()
    half = (len(words) + 1) // 2
    for index, line in enumerate((" ".join(words[:half]), " ".join(words[half:]))):
        text(draw, (GAP_PX, middle - 6 + 20 * index), line, size=15, fill=FAINT, anchor="lm")


def main() -> None:
    wall = object_mesh(find_object("cup").mesh, MAX_FACES)
    found = touches(wall)
    cells = {
        distance: [
            picture
            for touch in found
            for picture in render(wall, touch, touch.contact_map(distance, wall))
        ]
        for distance in DISTANCES
    }
    OUT.parent.mkdir(parents=True, exist_ok=True)
    compose(cells, [touch.title for touch in found]).save(OUT, optimize=True)
    print(f"{OUT.name}: {OUT.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
