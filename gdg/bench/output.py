"""A finished table as text, Markdown, CSV, JSON and a figure."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gdg.bench.run import Bench, BenchRow
from gdg.bench.tables import Published
from gdg.data.atomic import write_text_atomically
from gdg.data.json_values import finite_or_none
from gdg.evaluation.figure import Bar, draw_bars
from gdg.evaluation.rows import Row
from gdg.evaluation.tables import (
    UNKNOWN,
    csv_text,
    flat_numbers,
    markdown_table,
    measured_on,
    number,
    percent,
    span,
    tree_of,
)

HEADER = (
    "method", "n", "success %", "95 %", "published", "ours − published", "trials %", "pass@1 %",
    "diversity rad", "published", "plan s", "simulate s", "published s", "note",
)  # fmt: skip
#: Of a row that the paper does not have.
NOT_PUBLISHED = Published(math.nan)


def table_rows(bench: Bench) -> list[list[str]]:
    """The cells of the table as text, in the order of ``HEADER``."""
    return [_cells(row) for row in bench.rows]


def short_rows(bench: Bench) -> list[list[str]]:
    """The same with the first words of each note, for a terminal; ``row_notes`` has the rest."""
    return [[*cells[:-1], cells[-1].partition(":")[0]] for cells in table_rows(bench)]


def row_notes(bench: Bench) -> list[str]:
    """Why rows have no numbers, or what is to be said of them, a line each that can be copied."""
    return [f"{name_of(row)}: {row.note}" for row in bench.rows if row.note]


def _cells(bench_row: BenchRow) -> list[str]:
    row, published = bench_row.row, bench_row.method.published or NOT_PUBLISHED
    success = [UNKNOWN] * 3
    spread, seconds = UNKNOWN, [UNKNOWN] * 2
    difference, more = UNKNOWN, [UNKNOWN] * 2
    if row is not None:
        success = [str(row.success.n), percent(row.success.share), span(row.success.interval)]
        difference = _difference(row, published)
        more = [percent(row.trials.share), percent(row.first.share, 0)]
        spread = number(row.spread.joints_rad, 3)
        seconds = [number(row.seconds["plan"], 2), number(row.seconds["simulate"], 2)]
    return [
        name_of(bench_row), *success, number(published.success, 1), difference, *more, spread,
        _digits(published.diversity_rad), *seconds, _seconds(published), bench_row.note,
    ]  # fmt: skip


def name_of(row: BenchRow) -> str:
    """The method with what tells its rows apart."""
    return " · ".join(filter(None, (row.method.label, row.settings)))


def _difference(ours: Row, published: Published) -> str:
    """Points that we are above the paper, with the interval of our mean over objects."""
    mean, low, high = (100 * share for share in ours.macro)
    if math.isnan(published.success):
        return UNKNOWN
    points = f"{mean - published.success:+.0f}"
    if math.isnan(low):
        return points
    low, high = (end - published.success for end in (max(low, 0.0), min(high, 100.0)))
    return f"{points} ({low:+.0f} to {high:+.0f})"


def _digits(value: float | None) -> str:
    return UNKNOWN if value is None else f"{value:.3f}"


def _seconds(published: Published) -> str:
    if published.seconds is None:
        return UNKNOWN
    return f"{'> ' if published.at_least else ''}{published.seconds:g}"


def claim_lines(bench: Bench) -> list[str]:
    """One sentence per claim of the paper."""
    return [verdict.sentence for verdict in bench.claims]


def notes(bench: Bench) -> list[str]:
    """How to read the table, and what it was measured on."""
    rows = [row.row for row in bench.rows if row.row is not None]
    return [
        "Success counts grasps that were asked for and not found as failures; its 95 % are "
        "Wilson's, as if grasps were independent. ours − published is in points, with the 95 % "
        "interval of our mean over objects; the published number is taken as it stands. Diversity "
        "is the mean over objects. Claims are judged by 95 % intervals of differences object by "
        "object.",
        *(measured_on(rows) if rows else []),
    ]


def markdown(bench: Bench) -> str:
    """The table with caption, claims and notes."""
    claims = "\n".join(f"- {line}" for line in claim_lines(bench))
    table = markdown_table(HEADER, table_rows(bench))
    parts = [f"# {bench.table.name}", bench.caption, table, claims, *notes(bench)]
    return "\n\n".join(part.rstrip("\n") for part in parts) + "\n"


def write_bench(bench: Bench) -> list[Path]:
    """Writes Markdown, CSV, JSON and the figure; gives their paths."""
    paths = [
        bench.folder / f"{bench.table.name}.{suffix}" for suffix in ("md", "csv", "json", "png")
    ]
    page, table, tree, picture = paths
    write_text_atomically(page, markdown(bench))
    write_text_atomically(table, csv_text([_line(row) for row in bench.rows]))
    write_text_atomically(tree, json.dumps(finite_or_none(_tree(bench)), indent=1) + "\n")
    draw_bars([_bar(row) for row in bench.rows], picture, bench.table.title)
    return paths


def _line(row: BenchRow) -> dict[str, Any]:
    published = row.method.published or NOT_PUBLISHED
    line: dict[str, Any] = {"method": row.method.label, "hand": row.method.hand}
    line |= {"settings": row.settings, "note": row.note}
    line |= {f"published_{name}": value for name, value in asdict(published).items()}
    return line | (_without(flat_numbers(row.row), "hand") if row.row is not None else {})


def _without(line: dict[str, Any], key: str) -> dict[str, Any]:
    return {name: value for name, value in line.items() if name != key}


def _tree(bench: Bench) -> dict[str, Any]:
    return {
        "table": bench.table.name,
        "caption": bench.caption,
        "weights": [
            {"name": one.name, "sha256": one.sha256, "said": one.said} for one in bench.weights
        ],
        "rows": [
            {
                "method": asdict(row.method),
                "settings": row.settings,
                "note": row.note,
                "ours": None if row.row is None else tree_of(row.row),
            }
            for row in bench.rows
        ],
        "claims": [asdict(verdict) for verdict in bench.claims],
    }


def _bar(row: BenchRow) -> Bar:
    published = row.method.published and row.method.published.success / 100
    if row.row is None or math.isnan(row.row.success.share):
        return Bar(name_of(row), None, published=published, note=row.note.partition(":")[0])
    return Bar(name_of(row), row.row.success.share, row.row.success.interval, published)


def failures(rows: Sequence[BenchRow]) -> list[str]:
    """One sentence for each row that a mistake kept from being measured."""
    return [f"{name_of(row)}: {row.note}" for row in rows if row.failed]
