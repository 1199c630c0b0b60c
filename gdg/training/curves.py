"""Learning curves: the figures of every epoch as a table and as a picture."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from gdg.data.atomic import atomic_path, write_text_atomically
from gdg.report.palette import CONTACT_SCALE, TOUCHING, unit_rgb

Rows = Sequence[Mapping[str, float]]
#: What is not drawn: the place in the run.
PLACE = ("epoch", "steps")
#: Figures side by side in the picture.
ACROSS = 3
TRAINING, VALIDATION = unit_rgb(TOUCHING), unit_rgb(CONTACT_SCALE[3])


def write_table(rows: Rows, path: Path) -> None:
    """A CSV file with a row per epoch and a column per figure."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    table = csv.DictWriter(text, names, restval="", lineterminator="\n")
    table.writeheader()
    table.writerows({name: f"{value:.6g}" for name, value in row.items()} for row in rows)
    write_text_atomically(path, text.getvalue())


def draw_curves(rows: Rows, path: Path) -> None:
    """A picture with one curve per figure: training and validation of one figure share an axis.

    A ring marks the epoch with the lowest validation figure.
    """
    from matplotlib.figure import Figure  # takes a second to import
    from matplotlib.ticker import MaxNLocator

    panels = _panels(rows)
    lines = max(1, math.ceil(len(panels) / ACROSS))
    figure = Figure(figsize=(3.8 * min(ACROSS, max(1, len(panels))), 3.0 * lines), layout="tight")
    for number, (title, names) in enumerate(panels.items()):
        axis = figure.add_subplot(lines, min(ACROSS, len(panels)), number + 1)
        for name in names:
            known = [(row["epoch"], row[name]) for row in rows if name in row]
            is_validation = name.startswith("val_")
            color = VALIDATION if is_validation else TRAINING
            label = "validation" if is_validation else "training"
            epochs, values = zip(*known, strict=True)
            axis.plot(epochs, values, color=color, lw=2, marker="." if len(known) < 40 else None,
                      label=label)  # fmt: skip
            if is_validation:
                best = min(known, key=lambda pair: pair[1])
                axis.plot(*best, "o", ms=11, mfc="none", mec=color)
        axis.set_title(title, fontsize=11)
        axis.set_xlabel("epoch")
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
        axis.spines[["top", "right"]].set_visible(False)
        axis.grid(axis="y", alpha=0.3)
        if len(names) > 1:
            axis.legend(frameon=False, fontsize=9)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=110, format="png")


def _panels(rows: Rows) -> dict[str, list[str]]:
    """Title of an axis -> names of its curves; ``train_x`` and ``val_x`` share the axis ``x``."""
    panels: dict[str, list[str]] = {}
    for name in sorted({name for row in rows for name in row if name not in PLACE}):
        title = name.removeprefix("train_").removeprefix("val_")
        panels.setdefault(title, []).append(name)
    return panels
