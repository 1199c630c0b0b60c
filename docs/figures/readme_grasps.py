"""Draws the README's picture: tested grasps of the bundled hands, planned by gdg itself.

    python docs/figures/readme_grasps.py

The grasps are those of ``gdg.grasp`` with the settings below; the picture shows the first that
passed for each pair.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from PIL import Image

import gdg
from gdg.config import compose
from gdg.pipeline.jobs import DEFAULTS, PairJob
from gdg.pipeline.pair import Pair
from gdg.registry import get_registry
from gdg.report.contact_sheet import contact_sheet

PAIRS = (("allegro", "apple"), ("barrett", "rubber_duck"), ("allegro", "water_bottle"))
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
    contact_sheet(pair.hand, pair.obj, grasps.select(grasps.passed[:1]), path, columns=1)
    with Image.open(path) as picture:
        return picture.convert("RGB")


if __name__ == "__main__":
    main()
