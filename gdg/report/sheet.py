"""Paper, ink and lines of text that all sheets of pictures share."""

from __future__ import annotations

from PIL import ImageDraw, ImageFont

#: Space between cells, pixels.
GAP_PX = 14
PAPER, CARD, LINE = (246, 247, 249), (255, 255, 255), (226, 229, 234)
INK, FAINT = (31, 35, 40), (101, 109, 118)

Box = tuple[int, int]


def write(
    draw: ImageDraw.ImageDraw,
    place: tuple[float, float],
    text: str,
    size: int,
    color: tuple[int, int, int],
    room: float,
) -> None:
    """One line of text, cut with an ellipsis where it is wider than ``room`` pixels."""
    line, face = " ".join(text.split()), font(size)
    if face.getlength(line) > room:
        while line and face.getlength(line + "…") > room:
            line = line[:-1]
        line += "…"
    draw.text(place, line, font=face, fill=color)


def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """The font of all sheets, in pixels."""
    return ImageFont.load_default(size)
