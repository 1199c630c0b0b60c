"""``gdg eval``."""

from __future__ import annotations

from pathlib import Path

import click

from gdg.cli.settings import configs_from, takes_settings
from gdg.pipeline.jobs import DEFAULTS, EvalJob

#: Characters per line of a table that is written into a file or pipe.
FILE_WIDTH = 160


@click.command()
@takes_settings(EvalJob, DEFAULTS)
def evaluate(settings: tuple[str, ...], files: tuple[Path, ...]) -> None:
    """Plan and test every cell of a grid (commas span it) and sum it up.

    Finished cells are kept in the output folder and never run twice. Prints success with its
    95 % interval, diversity, penetration and time; writes summary.json and summary.md.
    """
    configs = configs_from(EvalJob, DEFAULTS, files, settings)
    from rich.console import Console
    from rich.table import Table

    from gdg.cli.progress import bars
    from gdg.pipeline.evaluate import COLUMNS, cells, run_eval

    with bars() as progress:
        task = progress.add_task("cells", total=len(configs))

        def report(done: int, total: int, what: str) -> None:
            progress.update(task, completed=done, total=total, description=what or "cells")

        rows, folder = run_eval(configs, report)
    table = Table(header_style="bold")
    for title in (*rows[0].settings, *COLUMNS):
        table.add_column(title, overflow="fold")
    for row in rows:
        table.add_row(*cells(row))
    console = Console()
    if not console.is_terminal:  # a file or pipe has no width of its own
        console = Console(width=FILE_WIDTH)
    console.print(table)
    console.print(f"  {folder / 'summary.md'}", markup=False, soft_wrap=True)
