"""``gdg hands show``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from gdg.folders import HANDS, FoundFolder

if TYPE_CHECKING:
    from rich.console import Console

    from gdg.hands.hand import Hand

#: The picture of a hand that its folder may hold.
PICTURE = "picture.png"


@click.command("show")
@click.argument("hand")
@click.option(
    "--picture",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Draw the hand into this PNG file.",
)
def show_hand(hand: str, picture: Path | None) -> None:
    """Show joints, limits, postures, drives, palm and provenance of HAND (a name or a folder)."""
    from rich.console import Console

    from gdg.hands.hand import load_hand

    found = HANDS.find(hand)
    loaded, console = load_hand(found.path), Console()
    _print_head(console, loaded, found)
    _print_joints(console, loaded)
    _print_contacts(console, loaded)
    spec = loaded.spec
    console.print(f"source: {spec.provenance.source}", markup=False)
    console.print(f"licence: {spec.provenance.licence}", markup=False)
    stored = found.path / PICTURE
    if picture is not None:
        _draw(loaded, picture)
        click.echo(f"picture: {picture}")
    elif stored.is_file():
        click.echo(f"picture: {stored}")
    else:
        click.echo("picture: none in the folder; --picture FILE.png draws one")


def _print_head(console: Console, hand: Hand, found: FoundFolder) -> None:
    spec = hand.spec
    console.print(f"{spec.name}: {spec.title} ({hand.folder})", markup=False)
    origin = f"tier {found.tier}, from {found.origin}"
    hides = "".join(f", hides {path}" for path in found.shadows)
    console.print(origin + hides, markup=False)
    normal = " ".join(f"{value:g}" for value in spec.palm.normal)
    center = " ".join(f"{value:g}" for value in spec.palm.center)
    palm = f"palm {spec.palm.link}, normal ({normal}), centre ({center}) m"
    console.print(f"root link {spec.root_link}; {palm}", markup=False)


def _print_joints(console: Console, hand: Hand) -> None:
    from rich.box import SIMPLE
    from rich.table import Table
    from rich.text import Text

    from gdg.hands.describe import followers

    table = Table(box=SIMPLE, pad_edge=False, header_style="bold")
    table.add_column("joint", overflow="fold")
    for title in ("type", "limits", "open", "closed", "drive"):
        table.add_column(title, no_wrap=True, justify="left" if title == "type" else "right")
    lower, upper = hand.limits()
    opened, closed = hand.posture("open"), hand.posture("closed")
    for i, name in enumerate(hand.spec.joints):
        drive = hand.spec.drives.of(name)
        values = f"{lower[i]:.3f} … {upper[i]:.3f}", f"{opened[i]:.3f}", f"{closed[i]:.3f}"
        gains = f"{drive.stiffness:g} / {drive.damping:g} / {drive.force_limit:g}"
        # Text, not str: rich would read [brackets] in names as markup
        table.add_row(Text(name), hand.urdf.joints[name].type, *values, gains)
    console.print(table)
    console.print("drive: stiffness / damping / force limit; rad and N m, or m and N", markup=False)
    following = followers(hand)
    if following:
        console.print("mimic joints: " + ", ".join(following), markup=False)


def _print_contacts(console: Console, hand: Hand) -> None:
    spec = hand.spec
    regions = ", ".join(f"{link} {len(r)}" for link, r in spec.contact_regions.items())
    console.print(f"contact regions: {regions or 'none'}", markup=False)
    allowed = ", ".join(f"{a} and {b}" for a, b in spec.allowed_self_contacts)
    if allowed:
        console.print(f"allowed self-contacts: {allowed}", markup=False)


def _draw(hand: Hand, picture: Path) -> None:
    from gdg.report.hand_sheet import hand_sheet
    from gdg.testing.fixtures import model_of

    hand_sheet(model_of(hand), picture)
