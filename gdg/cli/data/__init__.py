"""``gdg data``. Light: each subcommand's module is imported when it is used."""

from __future__ import annotations

import click

from gdg.cli.lazy import LazyCommands

#: Subcommand -> ("module:command", summary), in the order of ``gdg data --help``.
COMMANDS = {
    "info": ("gdg.cli.data.info:info", "Count grasps per hand and object."),
    "validate": ("gdg.cli.data.validate:validate", "Check every file, and tell all mistakes."),
    "merge": ("gdg.cli.data.merge:merge", "Unite datasets; duplicates are dropped."),
    "split": ("gdg.cli.data.split:split", "Write a lock file of train and test."),
    "export": ("gdg.cli.data.export:export", "Write a dataset in another layout."),
    "import": ("gdg.cli.data.import_:import_", "Read grasps of another layout into a dataset."),
}


@click.group(cls=LazyCommands, targets=COMMANDS)
def data() -> None:
    """Inspect, check, merge and split grasp datasets."""
