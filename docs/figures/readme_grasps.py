"""Draws the README's picture: tested grasps of the bundled hands, planned by gdg itself.

    python docs/figures/readme_grasps.py

The grasps are those of ``gdg.grasp`` with its defaults; for each pair the picture shows the one
that passed in most of the shifted trials, and of these the one whose object moved least.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from PIL import Image

import gdg
from gdg.config import compose
from gdg.data.grasps import GraspSet
from gdg.pipeline.jobs import DEFAULTS, PairJob
from gdg.pipeline.pair import Pair
from gdg.registry import get_registry
from gdg.report.contact_sheet import contact_sheet

PAIRS = (
    ("allegro", "camera"),
    ("barrett", "apple"),
    ("allegro", "rubber_duck"),
    ("barrett", "mug"),
)
#: A sheet of one grasp is wider than its one cell, for the header's sake; pixels.
CELL_WIDTH = 430
OUT = Path(__file__).parents[1] / "images" / "readme-grasps.png"


def main() -> None:
    """Plans, tests and draws one passing grasp per pair, side by side."""
    with tempfile.TemporaryDirectory() as folder:
        cells = [_cell(hand, name, Path(folder)) for hand, name in PAIRS]
        sheet = Image.new("RGB", (sum(c.width for c in cells), max(c.height for c in cells)))
        left = 0
        for cell in cells:
            sheet.paste(cell, (left, 0))
            left += cell.width
    sheet.save(OUT)
    print(OUT)


def _cell(hand: str, name: str, folder: Path) -> Image.Image:
    grasps = gdg.grasp(hand, name, n=8)
    words = [f"hand={hand}", f"object={name}"]
    pair = Pair.load(compose(PairJob, get_registry(), DEFAULTS, (), words)[0])
    path = folder / f"{hand}-{name}.png"
    contact_sheet(pair.hand, pair.obj, grasps.select([_firmest(grasps)]), path, columns=1)
    with Image.open(path) as picture:
        return picture.convert("RGB").crop((0, 0, CELL_WIDTH, picture.height))


def _firmest(grasps: GraspSet) -> int:
    def looseness(index: int) -> tuple[float, float]:
        verdict = grasps.verdicts[index]
        return -sum(verdict.shift_successes), max(verdict.displacement_m)

    return min(grasps.passed, key=looseness)


if __name__ == "__main__":
    main()
