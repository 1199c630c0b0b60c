"""Rows as tables: for the terminal, Markdown, CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gdg.data.atomic import write_text_atomically
from gdg.data.json_values import finite_or_none
from gdg.evaluation.rows import STAGES, Row
from gdg.metrics import Rate

#: Stands for a number that is not known.
UNKNOWN = "–"
#: Title -> text of a row, a table each.
Columns = dict[str, Callable[[Row], str]]


def number(value: float, digits: int) -> str:
    """A number with so many decimals; a dash where it is not known."""
    return f"{value:.{digits}f}" if math.isfinite(value) else UNKNOWN


def percent(share: float, digits: int = 1) -> str:
    """A share in per cent."""
    return number(100 * share, digits)


def span(interval: tuple[float, float]) -> str:
    """An interval of shares in whole per cent, cut to what a share can be."""
    low, high = (min(1.0, max(0.0, end)) for end in interval)
    return UNKNOWN if math.isnan(sum(interval)) else f"{100 * low:.0f}–{100 * high:.0f}"


SUCCESS: Columns = {
    "protocol": lambda row: row.protocol or UNKNOWN,
    "objects": lambda row: str(len(row.objects)),
    "seeds": lambda row: str(row.seeds),
    "n": lambda row: str(row.success.n),
    "success %": lambda row: percent(row.success.share),
    "95 %": lambda row: span(row.success.interval),
    "by object %": lambda row: percent(row.macro[0]),
    "95 % over objects": lambda row: span(row.macro[1:]),
    "trials %": lambda row: percent(row.trials.share),
    "stable %": lambda row: percent(row.stable, 0),
    "pass@1 %": lambda row: percent(row.first.share, 0),
    "best of n %": lambda row: f"{percent(row.any.share, 0)} (n = {row.n})",
}
GRASPS: Columns = {
    "diversity rad": lambda row: number(row.spread.joints_rad, 3),
    "pooled rad": lambda row: number(row.spread.joints_pooled_rad, 3),
    "directions %": lambda row: percent(row.spread.coverage, 0),
    "distinct": lambda row: str(row.spread.distinct),
    "penetration mm": lambda row: number(row.penetration_mm["median"], 2),
    "p95 mm": lambda row: number(row.penetration_mm["p95"], 2),
    "max mm": lambda row: number(row.penetration_mm["max"], 2),
    "ε": lambda row: number(row.quality["epsilon"], 3),
    "volume": lambda row: number(row.quality["volume"], 3),
}
TIME: Columns = {
    **{f"{stage} s": lambda row, stage=stage: number(row.seconds[stage], 2) for stage in STAGES},
    "failures": lambda row: counted(row.failures),
}
#: What fits on a terminal.
BRIEF: Columns = {
    **{title: SUCCESS[title] for title in list(SUCCESS)[:6]},
    **{title: SUCCESS[title] for title in ("trials %", "stable %", "pass@1 %", "best of n %")},
    **{title: GRASPS[title] for title in ("diversity rad", "penetration mm")},
    **{title: TIME[title] for title in ("plan s", "simulate s")},
}


def counted(counts: dict[str, int]) -> str:
    """Reasons with their counts, the commonest first."""
    return ", ".join(f"{count} {reason}" for reason, count in counts.items()) or "none"


def header(rows: Sequence[Row], columns: Columns) -> list[str]:
    """The titles of the settings and the columns, in the order of ``cells``."""
    return [*_settings(rows[0], columns), *columns]


def cells(row: Row, columns: Columns) -> list[str]:
    """The settings and the columns of a row as text."""
    return [*_settings(row, columns).values(), *(text(row) for text in columns.values())]


def _settings(row: Row, columns: Columns) -> dict[str, str]:
    """The settings in which rows differ, without those that have a column of their own."""
    return {name: value for name, value in row.settings.items() if name not in columns}


def markdown_table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(titles) + " |", "|" + " --- |" * len(titles)]
    lines += ["| " + " | ".join(text.replace("|", "\\|") for text in row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def markdown(rows: Sequence[Row]) -> str:
    """The summary: success, the passing grasps, time and failures, what it was measured on."""
    parts = []
    for title, columns in (("Success", SUCCESS), ("Grasps", GRASPS), ("Time", TIME)):
        table = markdown_table(header(rows, columns), [cells(row, columns) for row in rows])
        parts.append(f"## {title}\n\n{table}")
    return "\n".join([*parts, *measured_on(rows)]) + "\n"


def measured_on(rows: Sequence[Row]) -> list[str]:
    """Sentences about engines, what they leave out, and hardware."""
    engines = dict.fromkeys(engine for row in rows for engine in row.engines)
    machines = dict.fromkeys(machine for row in rows for machine in row.hardware)
    loads = [row.load for row in rows if math.isfinite(row.load)]
    busy = ""
    if loads and max(loads) > 1:
        busy = (
            f" Up to {max(loads):.1f} processes per core ran meanwhile (in part our own), so "
            f"seconds are upper bounds."
        )
    return [
        f"Seconds are per grasp asked for. Engines: {', '.join(engines) or 'none'}. "
        f"Hardware: {'; '.join(machines) or 'unknown'}.{busy}",
        *dict.fromkeys(sentence for row in rows for sentence in row.left_out),
    ]


def tree_of(row: Row) -> dict[str, Any]:
    """A row as plain values, rates with share and interval; None where one is not known."""
    tree = asdict(row)
    for name in ("success", "trials", "first", "any"):
        rate: Rate = getattr(row, name)
        tree[name] = rate.as_dict()
    for place, one in enumerate(row.objects):
        tree["objects"][place]["success"] = one.success.as_dict()
    tree["macro"] = dict(zip(("mean", "low", "high"), row.macro, strict=True))
    return finite_or_none(tree)


def flat_numbers(row: Row) -> dict[str, Any]:
    """A row as one line of a CSV file."""
    line: dict[str, Any] = {**row.settings, "protocol": row.protocol, "n": row.n}
    line |= {"objects": len(row.objects), "seeds": row.seeds}
    for name in ("success", "trials", "first", "any"):
        rate: Rate = getattr(row, name)
        low, high = rate.interval
        line |= {f"{name}_k": rate.k, f"{name}_n": rate.n, f"{name}_share": rate.share}
        line |= {f"{name}_low": low, f"{name}_high": high}
    line |= dict(zip(("macro", "macro_low", "macro_high"), row.macro, strict=True))
    line |= {"stable": row.stable, **asdict(row.spread)}
    line |= {f"penetration_mm_{name}": value for name, value in row.penetration_mm.items()}
    line |= row.quality | {f"seconds_{stage}": row.seconds[stage] for stage in STAGES}
    line |= {"failures": counted(row.failures), "rejected": counted(row.rejected)}
    return line | {"engines": ", ".join(row.engines), "hardware": "; ".join(row.hardware)}


def csv_text(lines: Sequence[dict[str, Any]]) -> str:
    """Lines of one or more shapes as CSV; empty where a number is not known."""
    columns = list(dict.fromkeys(name for line in lines for name in line))
    stream = io.StringIO()
    writer = csv.DictWriter(stream, columns, restval="", lineterminator="\n")
    writer.writeheader()
    for line in lines:
        known = finite_or_none(line)
        writer.writerow({k: "" if v is None else v for k, v in known.items()})
    return stream.getvalue()


def write_summary(folder: Path, rows: Sequence[Row]) -> None:
    """Writes ``summary.json``, ``summary.md`` and ``summary.csv``."""
    tree = [tree_of(row) for row in rows]
    write_text_atomically(folder / "summary.json", json.dumps(tree, indent=1) + "\n")
    write_text_atomically(folder / "summary.md", markdown(rows))
    write_text_atomically(folder / "summary.csv", csv_text([flat_numbers(row) for row in rows]))
