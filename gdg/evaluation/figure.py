"""Success rates as bars with their intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gdg.config import GROUPS
from gdg.data.atomic import atomic_path
from gdg.evaluation.rows import Row
from gdg.report.palette import CONTACT_SCALE, FAIL, HAND, unit_rgb

#: Height of a bar with the space around it, inches; more bars than this are not drawn in one.
BAR_INCHES, MOST_BARS = 0.32, 60


@dataclass(frozen=True)
class Bar:
    """A bar.

    Attributes:
        label: what stands beside it.
        share: its length, 0 to 1; None for a bar that is missing.
        interval: ends of its whisker.
        published: share that a paper reports, as a mark; None for none.
        note: text in place of a missing bar.
    """

    label: str
    share: float | None
    interval: tuple[float, float] = (0.0, 1.0)
    published: float | None = None
    note: str = ""


def draw_rows(rows: Sequence[Row], path: Path) -> None:
    """Draws the success of each row."""
    bars = [Bar(_label(row.settings), row.success.share, row.success.interval) for row in rows]
    protocols = ", ".join(dict.fromkeys(row.protocol for row in rows if row.protocol))
    draw_bars(bars, path, f"grasps that pass {protocols}")


def _label(settings: dict[str, str]) -> str:
    """Names of hand and components speak for themselves; other values don't."""
    words = [v if k == "hand" or k in GROUPS else f"{k}={v}" for k, v in settings.items()]
    return " · ".join(words)


def draw_bars(bars: Sequence[Bar], path: Path, title: str) -> None:
    """Draws bars from top to bottom with their 95 % intervals, as a PNG.

    Args:
        bars: of which the first ``MOST_BARS`` are drawn.
        path: of the picture.
        title: above it.
    """
    from matplotlib.figure import Figure  # half a second to import

    shown = bars[:MOST_BARS]
    figure = Figure(figsize=(8.0, 1.3 + BAR_INCHES * len(shown)), layout="constrained")
    axes = figure.add_subplot()
    for place, bar in enumerate(shown):
        if bar.share is None:
            axes.text(1, place, bar.note, va="center", fontsize=8, color=unit_rgb(FAIL))
        else:
            _draw_bar(axes, place, bar)
    marked = [
        (place, bar.published) for place, bar in enumerate(shown) if bar.published is not None
    ]
    if marked:
        places, shares = zip(*marked, strict=True)
        color = unit_rgb(CONTACT_SCALE[4])
        values = [100 * share for share in shares]
        axes.plot(values, places, "D", color=color, markersize=5, label="published")
        axes.legend(loc="lower right", fontsize=8)
    axes.set_yticks(range(len(shown)), [bar.label for bar in shown], fontsize=8)
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.set_xlim(0, 108)
    axes.set_xlabel("success %, with 95 % interval", fontsize=8)
    axes.set_title(title, fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="x", color="0.9")
    axes.set_axisbelow(True)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=150, format="png")


def _draw_bar(axes: object, place: int, bar: Bar) -> None:
    assert bar.share is not None
    low, high = bar.interval
    ends = [[100 * (bar.share - low)], [100 * (high - bar.share)]]
    axes.barh(place, 100 * bar.share, 0.62, color=unit_rgb(HAND))  # type: ignore[attr-defined]
    axes.errorbar(  # type: ignore[attr-defined]
        100 * bar.share, place, xerr=ends, color="0.25", capsize=3, linewidth=1
    )
    axes.text(  # type: ignore[attr-defined]
        min(100 * high + 1, 101), place, f"{100 * bar.share:.0f}", va="center", fontsize=8
    )
