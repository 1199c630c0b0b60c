"""``gdg bench``."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from gdg.bench.job import BenchJob
from gdg.bench.tables import TABLES, find_table
from gdg.cli.settings import takes_settings
from gdg.errors import raise_if_any
from gdg.pipeline.jobs import DEFAULTS

_TABLES = "\n".join(f"  {table.name}  {table.title}" for table in TABLES.values())


def _lists_tables(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator: adds the tables to the help."""
    function.__doc__ = f"{inspect.getdoc(function)}\n\n\b\nTables:\n{_TABLES}"
    return function


@click.command()
@click.argument("table")
@click.option("--quick", is_flag=True, help="Two grasps on two objects: shows that all runs.")
@takes_settings(BenchJob, DEFAULTS)
@_lists_tables
def bench(table: str, settings: tuple[str, ...], files: tuple[Path, ...], quick: bool) -> None:
    """Print a table of the paper with our numbers beside the published ones.

    Rows are evaluated as by gdg eval; finished cells are kept and shared by all tables. Writes
    TABLE.md, .csv, .json and .png. A row whose weights are not there says how to train them, and
    one whose weights were trained otherwise than the row says gets no numbers.
    """
    chosen = find_table(table)
    from gdg.bench.output import (
        HEADER,
        claim_lines,
        failures,
        notes,
        row_notes,
        short_rows,
        write_bench,
    )
    from gdg.bench.run import run_bench
    from gdg.cli.evaluated import cell_bar, print_table

    with cell_bar() as report:
        done = run_bench(chosen, settings, files, quick, report)
    paths = write_bench(done)
    click.echo(done.caption)
    print_table(HEADER, short_rows(done))
    for line in (*row_notes(done), "", *claim_lines(done), "", *notes(done)):
        click.echo(line)
    for path in paths:
        click.echo(f"  {path}")
    raise_if_any(failures(done.rows))
