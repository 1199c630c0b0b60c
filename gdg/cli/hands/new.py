"""``gdg hands new``."""

from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gdg.text import one_line

if TYPE_CHECKING:
    from gdg.hands.create import NewHand
    from gdg.testing.findings import Finding

#: Surface points on which balls are gripped.
SURFACE_POINTS = 1000
#: With more joints before the palm than this, the description holds an arm.
LONGEST_WRIST = 3


@click.command("new")
@click.argument("source", type=click.Path(path_type=Path))
@click.argument("name", required=False)
@click.option("--root", metavar="LINK", help="Where the hand begins, if the file holds more.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="The folder to make; default: ./NAME.",
)
@click.option(
    "--packages",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    multiple=True,
    help="Where to look for the ROS packages that package:// paths name; may be repeated.",
)
def new_hand(
    source: Path, name: str | None, root: str | None, out: Path | None, packages: tuple[Path, ...]
) -> None:
    """Make a hand folder from SOURCE, a bare URDF or MJCF file.

    Finds palm, fingers, closing directions, postures, contact regions, self-contacts and drives
    from kinematics and shapes, and writes them with how sure it is into hand.yaml, report.html and
    picture.png. Correct hand.yaml where needed, then run gdg hands check.
    """
    from gdg.cli.hands.decision_table import print_decisions
    from gdg.hands.create import create_hand, name_from
    from gdg.testing.findings import errors_in
    from gdg.testing.fixtures import model_of
    from gdg.testing.hand import inspect

    chosen = name or name_from(out.resolve() if out else source)
    folder = out or Path(chosen)
    with _terminated_like_interrupted():
        made = create_hand(
            source,
            folder,
            chosen,
            lambda hand: model_of(hand, SURFACE_POINTS),
            root=root,
            package_paths=packages,
            say=lambda text: click.echo(f"{text} …", err=True),
        )
        findings = inspect(folder).findings
        _draw(made, folder, findings)
    print_decisions(made.proposal.decisions)
    for repair in made.intake.repairs:
        click.echo(f"changed: {repair}")
    for finding in findings:
        click.echo(f"{finding.severity}: {one_line(str(finding))}")
    _print_arm(made)
    click.echo(f"{folder}: hand.yaml, {made.intake.urdf.name}, report.html, picture.png")
    if errors_in(findings):
        click.echo(f"Next: mend the errors in hand.yaml, then gdg hands check {_as_path(folder)}")
        sys.exit(2)
    click.echo(f"Next: look at the report, then gdg grasp hand={_as_path(folder)} object=apple")


@contextlib.contextmanager
def _terminated_like_interrupted() -> Iterator[None]:
    """Lets ``kill`` end the command as Ctrl-C does, so that no unfinished folder is left behind."""

    def end(number: int, frame: object) -> None:
        sys.exit(128 + number)

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _draw(made: NewHand, folder: Path, findings: list[Finding]) -> None:
    from gdg.report.hand_report import hand_report
    from gdg.report.hand_sheet import hand_sheet
    from gdg.testing.fixtures import model_of

    model = model_of(made.hand)
    hand_sheet(model, folder / "picture.png")
    hand_report(
        model, folder / "report.html", made.proposal.decisions, made.intake.repairs, findings
    )


def _print_arm(made: NewHand) -> None:
    arm = made.proposal.structure.wrist
    if len(arm) > LONGEST_WRIST:
        click.echo(
            f"note: {len(arm)} joints lie between the root and the palm, as on an arm; for the "
            f"hand alone write --root and the link where it begins"
        )


def _as_path(folder: Path) -> str:
    """How the folder is given to other commands: with a separator, so that it is no name."""
    return str(folder) if len(folder.parts) > 1 else f"./{folder}"
