"""``gdg hands``. Light: what a command needs is imported when it runs."""

from __future__ import annotations

import click

from gdg.cli.hands.check import check_hands
from gdg.cli.hands.new import new_hand
from gdg.cli.hands.show import show_hand
from gdg.cli.listing import print_folders
from gdg.folders import HANDS, FoundFolder
from gdg.hands.spec import read_spec


@click.group()
def hands() -> None:
    """Make, list, show and check hands."""


@hands.command("list")
def list_hands() -> None:
    """List every hand that a name can mean, how many joints it drives, and where it lies."""
    print_folders(HANDS, _describe)


def _describe(folder: FoundFolder) -> str:
    spec = read_spec(folder.path)
    joints = f"{len(spec.joints)} joint{'' if len(spec.joints) == 1 else 's'}"
    return f"{joints:>9}  {spec.title}"


hands.add_command(new_hand)
hands.add_command(show_hand)
hands.add_command(check_hands)
