"""What ``gdg eval`` and ``gdg bench`` show: a bar over cells, and tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.table import Table
from rich.text import Text

from gdg.cli.progress import bars

#: Characters per line of a table that is written into a file or pipe.
FILE_WIDTH = 200


@contextmanager
def cell_bar() -> Iterator[Callable[[int, int, str], None]]:
    """Gives the callback that tells how many cells are done; silent when stderr is no terminal."""
    with bars() as progress:
        task = progress.add_task("cells", total=None)

        def report(done: int, total: int, what: str) -> None:
            progress.update(task, completed=done, total=total, description=what or "cells")

        yield report


def print_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Prints a table as wide as the terminal."""
    table = Table(header_style="bold")
    for title in header:
        table.add_column(Text(title), overflow="fold")
    for row in rows:
        table.add_row(*map(Text, row))  # Text, not str: rich would read [brackets] as markup
    console = Console()
    if not console.is_terminal:  # a file or pipe has no width of its own
        console = Console(width=FILE_WIDTH)
    console.print(table)
