"""A command group whose subcommands are imported when they are used. Light."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any

import click


class LazyCommands(click.Group):
    """A group that lists its commands without importing them.

    Args:
        targets: subcommand -> ("module:command", one-line summary), in the order of ``--help``.
        **options: of ``click.Group``.
    """

    def __init__(self, *args: Any, targets: Mapping[str, tuple[str, str]], **options: Any):
        super().__init__(*args, **options)
        self._targets = targets

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of the targets."""
        return list(self._targets)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Imports one command."""
        if cmd_name not in self._targets:
            return None
        module, _, attribute = self._targets[cmd_name][0].partition(":")
        return getattr(importlib.import_module(module), attribute)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Lists the commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, summary) for name, (_, summary) in self._targets.items()])
