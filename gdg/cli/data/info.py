"""``gdg data info``."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from rich.table import Table

    from gdg.data.info import DatasetInfo, Summary

#: Columns of measured figures that the table shows where a dataset has them, and their titles.
SHOWN = ("epsilon", "penetration")


@click.command("info")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--pairs", is_flag=True, help="One row per hand and object.")
@click.option("--json", "as_json", is_flag=True, help="All figures as JSON.")
def info(path: Path, pairs: bool, as_json: bool) -> None:
    """Count the grasps of the dataset in PATH per hand and per object.

    Reads only the ends of the files. Means are those of the grasps that passed their test.
    """
    from gdg.data.info import dataset_info

    found = dataset_info(path)
    if as_json:
        click.echo(json.dumps(_as_dict(found), indent=1))
    else:
        _print(found, pairs)
    for sentence in found.unreadable:
        click.echo(f"warning: {sentence}", err=True)
    if found.unreadable:
        click.echo(f"Next: gdg data validate {path}", err=True)


def _as_dict(found: DatasetInfo) -> dict[str, object]:
    return {
        "total": found.total().as_dict(),
        "hands": {name: sums.as_dict() for name, sums in found.by_hand().items()},
        "objects": {name: sums.as_dict() for name, sums in found.by_object().items()},
        "pairs": [
            {"hand": hand, "object": name, **sums.as_dict()}
            for (hand, name), sums in found.pairs.items()
        ],
        "unreadable": list(found.unreadable),
    }


def _print(found: DatasetInfo, pairs: bool) -> None:
    from rich.console import Console

    from gdg.text import one_line

    # a pipe has no width of its own
    console = Console(width=None if sys.stdout.isatty() else 160)
    total = found.total()
    names = [name for name in sorted(total.measured) if any(word in name for word in SHOWN)]
    # what was measured on the exact shapes, else what the simulator said
    names = [name for name in names if name.startswith("metric_")] or names
    groups = (
        [("hand", found.by_hand()), ("object", found.by_object())]
        if not pairs
        else [("hand · object", {f"{h} · {o}": sums for (h, o), sums in found.pairs.items()})]
    )
    for title, rows in groups:
        table = _table(title, names)
        for name, sums in rows.items():
            _add_row(table, name, sums, names)
        table.add_section()
        _add_row(table, f"{len(rows)} in all", total, names)
        console.print(table)
    seeds = ", ".join(map(str, sorted(total.seeds))) or "unknown"
    versions = ", ".join(map(str, sorted(total.versions))) or "none"
    console.print(f"schema {versions}; seeds {seeds}", markup=False)
    for (hand, name), sums in found.pairs.items():
        if not sums.grasps and sums.reasons:
            reasons = "; ".join(sorted(sums.reasons))
            console.print(one_line(f"{hand} · {name} has none: {reasons}"), markup=False)


def _table(title: str, measured: list[str]) -> Table:
    from rich.box import SIMPLE
    from rich.table import Table

    table = Table(box=SIMPLE, pad_edge=False, header_style="bold")
    table.add_column(title, overflow="fold")
    for name in ("grasps", "passed", "success", "shards", "disk"):
        table.add_column(name, justify="right", no_wrap=True)
    for name in measured:
        table.add_column(f"mean {name.removeprefix('metric_')}", justify="right")
    table.add_column("split", no_wrap=True)
    return table


def _add_row(table: Table, name: str, sums: Summary, measured: list[str]) -> None:
    from rich.text import Text

    rate = "" if sums.success_rate is None else f"{sums.success_rate:.1%}"
    means = [sums.mean(column) for column in measured]
    # Text, not str: rich would read [brackets] in names as markup
    table.add_row(
        Text(name),
        f"{sums.grasps:,}",
        f"{sums.passed:,}",
        rate,
        f"{sums.shards:,}",
        _size(sums.bytes),
        *("" if mean is None else f"{mean:.3g}" for mean in means),
        ", ".join(split or "none" for split in sorted(sums.splits)),
    )


def _size(count: int) -> str:
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000 or unit == "GB":
            return f"{count:.0f} {unit}" if unit == "B" else f"{count:.1f} {unit}"
        count /= 1000  # type: ignore[assignment]
    raise AssertionError
