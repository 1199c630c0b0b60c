"""``gdg hands``."""

from __future__ import annotations

import click

from gdg.cli.listing import print_folders
from gdg.folders import HANDS
from gdg.hands.spec import read_spec


@click.group()
def hands() -> None:
    """List and show hands."""


@hands.command("list")
def list_hands() -> None:
    """List every hand that a name can mean, and where it lies."""
    print_folders(HANDS, lambda folder: read_spec(folder.path).title)


@hands.command("show")
@click.argument("hand")
def show_hand(hand: str) -> None:
    """Show joints, limits, palm and contact regions of HAND (a name or a folder)."""
    from rich.console import Console
    from rich.table import Table

    from gdg.hands.hand import find_hand

    loaded, console = find_hand(hand), Console()
    spec = loaded.spec
    console.print(f"{spec.name}: {spec.title} ({loaded.folder})", markup=False)
    console.print(f"root link {spec.root_link}, palm {spec.palm.link} facing {spec.palm.normal}")
    table = Table("joint", "type", "lower", "upper", "open", "closed", header_style="bold")
    lower, upper = loaded.limits()
    opened, closed = loaded.posture("open"), loaded.posture("closed")
    for i, name in enumerate(spec.joints):
        values = (f"{v[i]:.3f}" for v in (lower, upper, opened, closed))
        table.add_row(name, loaded.urdf.joints[name].type, *values)
    console.print(table)
    followers = [f"{j.name} follows {j.mimic.joint}" for j in loaded.moving_joints if j.mimic]
    if followers:
        console.print("mimic joints: " + ", ".join(followers), markup=False)
    regions = ", ".join(f"{link} {len(r)}" for link, r in spec.contact_regions.items())
    console.print(f"contact regions: {regions}", markup=False)
    console.print(f"source: {spec.provenance.source}; licence: {spec.provenance.licence}")
