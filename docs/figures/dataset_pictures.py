"""Pictures of a dataset: grasps per pair, histograms, and a sheet of random passing grasps.

Imported by ``dataset.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from dataset_statistics import WANTED, PairFacts, hand_model, hands_of, metric, pairs_by_hand
from matplotlib import pyplot as plt
from matplotlib.colors import LinearSegmentedColormap
from PIL import Image, ImageDraw

from gdg.errors import GdgError
from gdg.objects.model import find_object
from gdg.report.palette import CONTACT_SCALE, HAND, unit_rgb
from gdg.report.render import SceneRenderer
from gdg.report.scene import build_scene
from gdg.report.sheet import CARD, FAINT, GAP_PX, INK, LINE, PAPER, write

#: Pictures of one row of the sheet: one random object each, one random grasp on it.
PER_HAND = 4
VIEW_PX, TITLE_PX, FONT_PX = (300, 270), 32, 18
#: Triangles of an object and a hand in the sheet.
FACES = 20_000
#: Objects in one column of the map of pairs.
PER_COLUMN = 37


def draw_pictures(pairs: Sequence[PairFacts], folder: Path) -> list[Path]:
    """Writes all pictures into a folder; gives their paths."""
    mpl.use("Agg")
    mpl.rcParams.update({"font.size": 12, "axes.spines.top": False, "axes.spines.right": False})
    folder.mkdir(parents=True, exist_ok=True)
    drawings = {
        "dataset-pairs.png": _draw_pairs,
        "dataset-quality.png": _draw_quality,
        "dataset-grasps.png": _draw_sheet,
    }
    for name, draw in drawings.items():
        draw(pairs, folder / name)
    return [folder / name for name in drawings]


def _draw_pairs(pairs: Sequence[PairFacts], path: Path) -> None:
    """Passing grasps of each hand on each object."""
    hands, names = hands_of(pairs), sorted({pair.object_name for pair in pairs}, key=_by_source)
    counts = {(pair.hand, pair.object_name): len(pair) for pair in pairs}
    columns = [names[i : i + PER_COLUMN] for i in range(0, len(names), PER_COLUMN)]
    tallest = max(map(len, columns))
    figure, axes = plt.subplots(
        1,
        len(columns),
        figsize=(4.6 * len(columns), 0.28 * tallest + 1.3),
        squeeze=False,
        layout="constrained",
    )
    scale = LinearSegmentedColormap.from_list(
        "grasps", [unit_rgb(CONTACT_SCALE[3]), unit_rgb(CONTACT_SCALE[1]), unit_rgb(HAND)]
    )
    for axis, column in zip(axes[0], columns):
        table = np.array([[counts.get((hand, name), np.nan) for hand in hands] for name in column])
        axis.imshow(np.minimum(table, WANTED), cmap=scale, vmin=0, vmax=WANTED, aspect="auto")
        for (row, place), count in np.ndenumerate(table):
            if np.isfinite(count):
                axis.text(place, row, f"{count:.0f}", ha="center", va="center", fontsize=10)
        axis.set_ylim(tallest - 0.5, -0.5)
        axis.set_yticks(range(len(column)), column)
        axis.set_xticks(range(len(hands)), hands, rotation=30, ha="left")
        axis.tick_params(length=0, top=False, labeltop=True, bottom=False, labelbottom=False)
        axis.spines[:].set_visible(False)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _by_source(name: str) -> tuple[bool, str]:
    """Bundled objects come before published ones."""
    return "+" in name, name


def _draw_quality(pairs: Sequence[PairFacts], path: Path) -> None:
    """Histograms of penetration and ε of the passing grasps, one column per hand."""
    rows: list[tuple[str, str, np.ndarray]] = [
        ("penetration_mm", "penetration (mm)", np.linspace(0, 1, 26)),
        ("epsilon", "ε (no unit)", np.linspace(0, 0.1, 26)),
    ]
    hands = hands_of(pairs)
    figure, axes = plt.subplots(
        len(rows), len(hands), figsize=(2.7 * len(hands), 4.6), squeeze=False,
        sharey="row", layout="constrained",
    )  # fmt: skip
    for column, hand in enumerate(hands):
        own = [pair for pair in pairs if pair.hand == hand]
        for row, (name, label, edges) in enumerate(rows):
            _histogram(axes[row, column], np.minimum(metric(own, name), edges[-1]), edges)
            axes[row, column].set_xlabel(label)
        axes[0, column].set_title(hand, fontsize=12)
    for row in range(len(rows)):
        axes[row, 0].set_ylabel("% of the grasps")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _histogram(axis: Any, values: np.ndarray, edges: np.ndarray) -> None:
    """Shares in percent, with the median; the last bin holds what is beyond it, too."""
    if not len(values):
        return
    axis.hist(values, edges, weights=np.full(len(values), 100 / len(values)), color=unit_rgb(HAND))
    median = float(np.median(values))
    axis.axvline(median, color=unit_rgb(CONTACT_SCALE[4]), linewidth=1.5)
    text = axis.get_xaxis_transform()
    axis.text(median, 0.96, f" median {median:.2g}", transform=text, va="top", fontsize=11)


def _draw_sheet(pairs: Sequence[PairFacts], path: Path) -> None:
    """One row per hand: random passing grasps on random objects that can be found here."""
    rng = np.random.default_rng(0)
    rows = [_row(own, rng) for _, own in pairs_by_hand(pairs)]
    width, height = VIEW_PX[0] + 2, VIEW_PX[1] + TITLE_PX
    across = max(map(len, rows))
    size = (across * (width + GAP_PX) + GAP_PX, len(rows) * (height + GAP_PX) + GAP_PX)
    sheet = Image.new("RGB", size, PAPER)
    for row, cells in enumerate(rows):
        for column, (title, picture) in enumerate(cells):
            cell = Image.new("RGB", (width, height), CARD)
            cell.paste(picture, (1, TITLE_PX - 1))
            draw = ImageDraw.Draw(cell)
            hand, _, rest = title.partition(" ")
            write(draw, (9, 6), hand, FONT_PX, INK, width)
            start = 9 + draw.textlength(f"{hand} ", font_size=FONT_PX)
            write(draw, (start, 6), rest, FONT_PX, FAINT, width - start - 9)
            draw.rectangle((0, 0, width - 1, height - 1), outline=LINE)
            sheet.paste(
                cell, (GAP_PX + column * (width + GAP_PX), GAP_PX + row * (height + GAP_PX))
            )
    sheet.quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)


def _row(pairs: Sequence[PairFacts], rng: np.random.Generator) -> list[tuple[str, Image.Image]]:
    """Titles and pictures of one hand."""
    cells: list[tuple[str, Image.Image]] = []
    for index in rng.permutation(len(pairs)):
        if len(cells) == PER_HAND:
            break
        pair = pairs[index]
        grasp = int(rng.integers(len(pair)))
        try:
            cells.append((f"{pair.hand} · {pair.object_name}", _picture(pair, grasp)))
        except GdgError as error:
            print(f"left out of the sheet: {error}")
    return cells


def _picture(pair: PairFacts, grasp: int) -> Image.Image:
    assert pair.passing is not None
    hand, obj = hand_model(pair.hand), find_object(pair.object_path)
    scene = build_scene(hand, obj, pair.passing.select([grasp]), FACES, FACES)
    with closing(SceneRenderer(scene, *VIEW_PX, background=unit_rgb(CARD))) as renderer:
        return renderer.grasp(0, scene.eyes[0][:1])[0]
