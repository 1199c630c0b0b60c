"""One picture of all grasps of a set: two views of each, contact map, verdict."""

from __future__ import annotations

import math
from contextlib import closing
from pathlib import Path

from PIL import Image, ImageDraw

from gdg.data.atomic import atomic_path
from gdg.data.grasps import GraspSet
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.report.palette import FAIL, PASS, UNKNOWN, contact_colors, unit_rgb
from gdg.report.render import SceneRenderer
from gdg.report.scene import build_scene
from gdg.report.sheet import CARD, FAINT, GAP_PX, INK, LINE, PAPER, Box, font, write
from gdg.report.table import millimetres, moved, summary_line

#: Triangles in pictures: a millimetre each on an object of 10 cm.
MAX_OBJECT_FACES, MAX_HAND_FACES = 40_000, 40_000
#: Sizes in pixels; a cell is two views above each other with the title on top.
HEADER_PX, TITLE_PX, CORNER_PX, EMPTY_PX = 58, 52, 8, 160
VIEW_PX: Box = (400, 330)

#: The pictures of each grasp.
Views = list[list[Image.Image]]


def contact_sheet(
    hand: HandModel,
    obj: ObjectModel,
    grasps: GraspSet,
    path: Path,
    columns: int = 4,
    view_size: Box = VIEW_PX,
) -> None:
    """Writes a PNG with one cell per grasp; without grasps it says that there are none.

    The object is coloured by the contact map where the set has one, else plain grey. Each grasp is
    seen from the two sides that show hand, object and contact best. Needs no display.

    Args:
        hand: the hand that the grasps belong to.
        obj: the object, with the points that the contact maps lie on.
        grasps: what to draw, at most a few dozen: the picture grows with every row.
        path: the PNG file, written atomically.
        columns: cells side by side; fewer when there are fewer grasps.
        view_size: width and height of each of the two views, pixels.

    Raises:
        GdgError: the grasps belong to another hand, or their contact maps to another object.
    """
    write_sheet(grasps, grasp_views(hand, obj, grasps, view_size), path, columns, view_size)


def grasp_views(
    hand: HandModel, obj: ObjectModel, grasps: GraspSet, view_size: Box = VIEW_PX
) -> Views:
    """Two views of each grasp, whatever became of it; see ``contact_sheet``."""
    if len(grasps) == 0:
        return []
    scene = build_scene(hand, obj, grasps, MAX_OBJECT_FACES, MAX_HAND_FACES)
    with closing(SceneRenderer(scene, *view_size, background=unit_rgb(CARD))) as renderer:
        return [renderer.grasp(index, scene.eyes[index]) for index in range(len(grasps))]


def write_sheet(
    grasps: GraspSet, views: Views, path: Path, columns: int = 4, view_size: Box = VIEW_PX
) -> None:
    """The contact sheet of grasps whose views are drawn; see ``contact_sheet``."""
    columns = max(1, min(columns, len(grasps)))
    sheet = Image.new("RGB", sheet_size(len(grasps), columns, view_size), PAPER)
    _draw_header(sheet, grasps)
    if len(grasps) == 0:
        _draw_empty(sheet)
    else:
        _draw_cells(sheet, views, grasps, columns, view_size)
    with atomic_path(path) as temporary:
        sheet.save(temporary, format="PNG")


def sheet_size(count: int, columns: int, view_size: Box = VIEW_PX) -> Box:
    """Width and height in pixels of a sheet of ``count`` grasps, at least 560 wide."""
    columns = max(1, min(columns, count))
    width, height = _cell_size(view_size)
    rows = math.ceil(count / columns)
    tall = rows * (height + GAP_PX) if count else EMPTY_PX
    return max(560, columns * (width + GAP_PX) + GAP_PX), HEADER_PX + tall


def _cell_size(view_size: Box) -> Box:
    return view_size[0] + 2, TITLE_PX + 2 * view_size[1] + 2


def _draw_cells(
    sheet: Image.Image, views: Views, grasps: GraspSet, columns: int, view_size: Box
) -> None:
    width, height = _cell_size(view_size)
    frame = (0, 0, width - 1, height - 1)
    mask = Image.new("L", (width, height), 0)
    ImageDraw.Draw(mask).rounded_rectangle(frame, radius=CORNER_PX, fill=255)
    for index, pictures in enumerate(views):
        cell = Image.new("RGB", (width, height), CARD)
        draw = ImageDraw.Draw(cell)
        _draw_title(draw, grasps, index, width)
        for view, picture in enumerate(pictures):
            cell.paste(picture, (1, TITLE_PX + 1 + view * view_size[1]))
        draw.rounded_rectangle(frame, radius=CORNER_PX, outline=LINE)
        row, column = divmod(index, columns)
        place = GAP_PX + column * (width + GAP_PX), HEADER_PX + row * (height + GAP_PX)
        sheet.paste(cell, place, mask)


def _draw_header(sheet: Image.Image, grasps: GraspSet) -> None:
    draw, room = ImageDraw.Draw(sheet), sheet.width - 2 * GAP_PX
    has_scale = grasps.contact_values is not None and sheet.width >= 1000
    room -= 250 if has_scale else 0
    write(draw, (GAP_PX + 2, 8), f"{grasps.hand} · {grasps.object_name}", 19, INK, room)
    write(draw, (GAP_PX + 2, 33), summary_line(grasps), 14, FAINT, room)
    if has_scale:
        _draw_scale(sheet, draw)


def _draw_scale(sheet: Image.Image, draw: ImageDraw.ImageDraw) -> None:
    width, left, top = 150, sheet.width - GAP_PX - 150, 14
    for x in range(width):
        color = tuple(int(c) for c in contact_colors(x / (width - 1)))
        draw.line((left + x, top, left + x, top + 11), fill=color)
    draw.rectangle((left - 1, top - 1, left + width, top + 12), outline=LINE)
    write(draw, (left, top + 16), "no contact", 12, FAINT, 80)
    text = "contact"
    write(draw, (left + width - font(12).getlength(text), top + 16), text, 12, FAINT, 80)


def _draw_empty(sheet: Image.Image) -> None:
    draw = ImageDraw.Draw(sheet)
    frame = (GAP_PX, HEADER_PX, sheet.width - GAP_PX - 1, sheet.height - GAP_PX - 1)
    draw.rounded_rectangle(frame, radius=CORNER_PX, fill=CARD, outline=LINE)
    middle = ((frame[0] + frame[2]) / 2, (frame[1] + frame[3]) / 2)
    draw.text(middle, "no grasp found", font=font(22), fill=FAINT, anchor="mm")


def _draw_title(draw: ImageDraw.ImageDraw, grasps: GraspSet, index: int, width: int) -> None:
    chip, color, protocol, details = _title(grasps, index)
    left, top, right = 12, 9, width - 12
    number = f"#{index}"
    write(draw, (left, top), number, 16, INK, right - left)
    start = left + font(16).getlength(number) + 8
    end = start + font(13).getlength(chip) + 14
    draw.rounded_rectangle((start, top, end, top + 19), radius=9, fill=color)
    draw.text(((start + end) / 2, top + 9.5), chip, font=font(13), fill=CARD, anchor="mm")
    write(draw, (end + 8, top + 2), protocol, 13, FAINT, right - end - 8)
    write(draw, (left, top + 23), details, 13, FAINT, right - left)


def _title(grasps: GraspSet, index: int) -> tuple[str, tuple[int, int, int], str, str]:
    """Chip text and colour, protocol, and details of one grasp."""
    if not grasps.verdicts:
        status = grasps.status[index] if grasps.status else ""
        return "not simulated", UNKNOWN, "", status
    verdict = grasps.verdicts[index]
    depth = f"penetration {verdict.penetration_start_mm:.1f} mm"
    details = f"moved {millimetres(moved(verdict))} mm · {depth}"
    if verdict.success:
        return "PASS", PASS, verdict.protocol, details
    return f"FAIL: {verdict.failure}", FAIL, verdict.protocol, details
