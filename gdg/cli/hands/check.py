"""``gdg hands check``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gdg.errors import GdgError
from gdg.folders import HANDS
from gdg.text import one_line

if TYPE_CHECKING:
    from gdg.testing.findings import Finding


@click.command("check")
@click.argument("given", metavar="HAND...", nargs=-1, required=True)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("."),
    help="Where the folder with the pictures goes; default: here.",
)
@click.option("--no-pictures", is_flag=True, help="Only check; write nothing.")
def check_hands(given: tuple[str, ...], out: Path, no_pictures: bool) -> None:
    """Check every HAND (a name or a folder) and tell all its mistakes at once.

    Writes <name>-check/hand.png and report.html with both postures, the palm and the contact
    regions. Ends with 2 if there are errors, with 0 if there are none or only warnings.
    """
    failed = [hand for hand in given if not _check(hand, None if no_pictures else out)]
    if failed:
        sys.exit(2)


def _check(given: str, out: Path | None) -> bool:
    """Checks one hand, prints what was found, and says whether it is free of errors."""
    from gdg.testing.findings import errors_in
    from gdg.testing.hand import inspect

    try:
        folder = HANDS.find(given).path
    except GdgError as error:
        click.echo(f"error: {one_line(str(error))}")
        return False
    inspected = inspect(folder)
    for finding in inspected.findings:
        click.echo(f"{finding.severity}: {one_line(str(finding))}")
    errors = errors_in(inspected.findings)
    click.echo(f"{given}: {_summary(inspected.findings, len(errors))}")
    if out is not None and inspected.case is not None:
        from gdg.report.hand_report import hand_report
        from gdg.report.hand_sheet import hand_sheet

        target = out / f"{inspected.case.hand.name}-check"
        hand_sheet(inspected.case.model, target / "hand.png")
        hand_report(inspected.case.model, target / "report.html", findings=inspected.findings)
        click.echo(f"pictures: {target / 'hand.png'}, {target / 'report.html'}")
    return not errors


def _summary(findings: list[Finding], errors: int) -> str:
    warnings = len(findings) - errors
    if not findings:
        return "no mistake found"
    return " and ".join(
        f"{count} {word}{'' if count == 1 else 's'}"
        for count, word in ((errors, "error"), (warnings, "warning"))
        if count
    )
