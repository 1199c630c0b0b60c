"""Prints data folders with their tiers. Light."""

from __future__ import annotations

from collections.abc import Callable

import click

from gdg.errors import GdgError
from gdg.folders import FolderKind, FoundFolder
from gdg.text import one_line


def print_folders(kind: FolderKind, describe: Callable[[FoundFolder], str]) -> None:
    """One line per folder: name, tier, description; a broken one says why."""
    found = kind.all()
    width = max((len(name) for name in found), default=0)
    for name, folder in found.items():
        try:
            text = describe(folder)
        except GdgError as error:
            text = f"BROKEN: {one_line(str(error).splitlines()[0])}"
        hidden = f"  (hides {', '.join(map(str, folder.shadows))})" if folder.shadows else ""
        twice = f"  (TWICE: also {folder.twins[0]})" if folder.twins else ""
        click.echo(f"{name:<{width}}  {folder.tier:<11}  {text}{hidden}{twice}")
    if not found:
        click.echo(f"No {kind.noun}s found.")
