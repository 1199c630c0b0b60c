"""Pictures of a hand by itself: postures, palm, contact regions and root frame."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
from PIL import Image, ImageChops, ImageDraw

from gdg.data.atomic import atomic_path
from gdg.kinds.hand_model import HandModel
from gdg.report.hand_scene import HandScene, build_hand_scene
from gdg.report.palette import AXES, PALM_ARROW, unit_rgb
from gdg.report.render import Renderer
from gdg.report.sheet import CARD, FAINT, GAP_PX, INK, LINE, PAPER, Box, font, write

#: Sizes in pixels: the head with the names, a line of the legend.
HEAD_PX, LEGEND_PX, CHIP_PX = 60, 22, 12
#: How strongly hidden markers show through the hand, of 255.
MAX_TRACE = 150
#: Colours in ``picture.png``: enough for smooth shading, and few enough for a small file.
PICTURE_COLORS = 96


def hand_sheet(hand: HandModel, path: Path, view_size: Box = (520, 440)) -> None:
    """Writes a PNG of a hand: open and closed side by side, from two directions, with a legend.

    It shows the shapes that gdg computes with (``geometry`` in the manifest), not the URDF's
    pictures. Contact regions lie slightly above the surface in one colour per finger; what is
    buried deeper than 3 mm stays hidden. The dark arrow is the palm's outward normal; red, green
    and blue are x, y and z of the root link, and show through the hand. The upper row may cut off
    what is far from the palm, such as a forearm.

    Args:
        hand: the hand.
        path: the PNG file, written atomically.
        view_size: width and height of each of the four views, pixels.
    """
    scene = build_hand_scene(hand)
    shown = (scene.near, scene.whole)
    views = [_views(scene, eye, points, view_size) for eye, points in zip(scene.eyes, shown)]
    entries = legend(scene)
    width = 2 * view_size[0] + 3 * GAP_PX
    lines = _wrapped(entries, width - 2 * GAP_PX)
    foot = len(lines) * LEGEND_PX + GAP_PX
    height = HEAD_PX + 2 * (view_size[1] + GAP_PX) + foot
    sheet = Image.new("RGB", (width, height), PAPER)
    draw = ImageDraw.Draw(sheet)
    _draw_head(draw, hand, width)
    for row, pictures in enumerate(views):
        for column, (name, picture) in enumerate(pictures.items()):
            place = (
                GAP_PX + column * (view_size[0] + GAP_PX),
                HEAD_PX + row * (view_size[1] + GAP_PX),
            )
            sheet.paste(picture, place)
            frame = (*place, place[0] + view_size[0] - 1, place[1] + view_size[1] - 1)
            draw.rectangle(frame, outline=LINE)
            draw.text((place[0] + 12, place[1] + 8), name, font=font(16), fill=FAINT)
    _drawlegend(draw, lines, height - foot)
    _save(sheet, path)


def hand_picture(hand: HandModel, path: Path, view_size: Box = (440, 400)) -> None:
    """Writes a small PNG of a hand, open beside closed, without markers or legend."""
    scene = build_hand_scene(hand)
    pictures = _views(scene, scene.eyes[0], scene.near, view_size, markers=False)
    sheet = Image.new("RGB", (2 * view_size[0], view_size[1]), CARD)
    for column, picture in enumerate(pictures.values()):
        sheet.paste(picture, (column * view_size[0], 0))
    _save(sheet.quantize(PICTURE_COLORS, dither=Image.Dither.NONE), path)


def _save(sheet: Image.Image, path: Path) -> None:
    with atomic_path(path) as temporary:
        sheet.save(temporary, format="PNG", optimize=True)


def _views(
    scene: HandScene, eye: np.ndarray, shown: np.ndarray, size: Box, markers: bool = True
) -> dict[str, Image.Image]:
    """Posture -> picture from one direction, all framed alike."""
    pictures = {}
    with closing(Renderer(*size, background=unit_rgb(CARD))) as renderer:
        drawn = [
            (item, renderer.add(item.mesh, unit_rgb(item.color)))
            for item in scene.items
            if markers or item.role == "hand"
        ]
        for name, poses in scene.postures.items():
            for item, mesh in drawn:
                mesh.place(poses[item.link])
            picture = renderer.picture(eye, shown)
            if markers:
                for item, mesh in drawn:
                    mesh.show(item.role == "root")
                picture = _seen_through(picture, renderer.picture(eye, shown))
                for _, mesh in drawn:
                    mesh.show(True)
            pictures[name] = picture
    return pictures


def _seen_through(picture: Image.Image, markers: Image.Image) -> Image.Image:
    """The picture with a trace of markers that the hand may hide; both on the same paper."""
    blank = Image.new("RGB", markers.size, CARD)
    mask = ImageChops.difference(markers, blank).convert("L")
    mask = mask.point([min(MAX_TRACE, 4 * value) for value in range(256)])
    return Image.composite(markers, picture, mask)


# -- text ----------------------------------------------------------------------------------------


def summary(hand: HandModel) -> str:
    """Joints, root link, palm link and size in one line."""
    loaded = hand.hand
    followers = sum(j.mimic is not None for j in loaded.moving_joints)
    count = f"{len(hand.joint_names)} joint{'s' if len(hand.joint_names) != 1 else ''}"
    moving = count + (f" ({followers} more follow)" if followers else "")
    return f"{moving} · root link {loaded.spec.root_link} · palm link {loaded.spec.palm.link}"


def _draw_head(draw: ImageDraw.ImageDraw, hand: HandModel, width: int) -> None:
    spec, room = hand.hand.spec, width - 2 * GAP_PX
    title = f"{spec.name} · {spec.title}" if spec.title else spec.name
    write(draw, (GAP_PX + 2, 8), title, 20, INK, room)
    write(draw, (GAP_PX + 2, 34), summary(hand), 14, FAINT, room)


def legend(scene: HandScene) -> list[tuple[tuple[int, int, int], str]]:
    """Colours with what they mean, in the order of the tree."""
    entries = [(PALM_ARROW, "palm normal")]
    entries += [(color, f"root {axis}") for color, axis in zip(AXES, "xyz", strict=True)]
    for chain in scene.chains:
        if chain.regions:
            what = "contact region" if chain.regions == 1 else "contact regions"
            entries.append((chain.color, f"{chain.name}: {chain.regions} {what}"))
    return entries


def _wrapped(
    entries: list[tuple[tuple[int, int, int], str]], room: int
) -> list[list[tuple[tuple[int, int, int], str, float]]]:
    """Entries in lines, each with its left edge."""
    lines: list[list[tuple[tuple[int, int, int], str, float]]] = [[]]
    left = 0.0
    for color, text in entries:
        wide = CHIP_PX + 6 + min(font(13).getlength(text), room / 2) + 20
        if left + wide > room and lines[-1]:
            lines.append([])
            left = 0.0
        lines[-1].append((color, text, left))
        left += wide
    return lines


def _drawlegend(
    draw: ImageDraw.ImageDraw,
    lines: list[list[tuple[tuple[int, int, int], str, float]]],
    top: int,
) -> None:
    for row, line in enumerate(lines):
        for color, text, left in line:
            x, y = GAP_PX + left, top + row * LEGEND_PX
            draw.rounded_rectangle((x, y + 3, x + CHIP_PX, y + 3 + CHIP_PX), radius=3, fill=color)
            room = (draw.im.size[0] - 2 * GAP_PX) / 2
            write(draw, (x + CHIP_PX + 6, y), text, 13, INK, room)
