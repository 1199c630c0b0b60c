"""Checks of a hand folder, beyond what loading it refuses."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from gdg.errors import GdgError, GdgErrors
from gdg.hands.hand import load_hand
from gdg.hands.spec import MANIFEST
from gdg.hands.urdf import read_urdf
from gdg.testing.checks import Check, attempt
from gdg.testing.findings import Finding, error
from gdg.testing.fixtures import model_of
from gdg.testing.hand import collisions, joints, links, manifest, masses, palm, regions
from gdg.testing.hand.case import SURFACE_POINTS, HandCase
from gdg.testing.hand.mending import mend, urdf_of
from gdg.yaml_files import read_yaml_mapping

#: In the order in which their findings are told.
CHECKS: tuple[Check[HandCase, Finding], ...] = (
    *manifest.CHECKS, *joints.CHECKS, *links.CHECKS, *palm.CHECKS, *regions.CHECKS,
    *collisions.CHECKS, *masses.CHECKS,
)  # fmt: skip


@dataclass(frozen=True)
class Inspection:
    """A checked hand.

    Attributes:
        findings: errors first.
        case: the loaded hand; None when it was refused.
    """

    findings: list[Finding]
    case: HandCase | None


def inspect(folder: Path) -> Inspection:
    """Loads a hand and runs every check; what refuses it is an error like the others."""
    loaded = load_case(folder)
    if loaded.case is not None:
        return Inspection(findings_of(loaded.case), loaded.case)
    told = {str(finding): finding for finding in [*loaded.findings, *_further_findings(folder)]}
    return Inspection(_errors_first(told.values()), None)


def load_case(folder: Path) -> Inspection:
    """Loads a hand for the checks; the findings are why it can't be loaded."""
    try:
        hand = load_hand(folder)
        return Inspection([], HandCase(hand, model_of(hand, SURFACE_POINTS)))
    except GdgError as mistake:
        told = [*_messages(mistake), *_urdf_mistakes(folder)]
        return Inspection([error("", message) for message in dict.fromkeys(told)], None)


def _urdf_mistakes(folder: Path) -> list[str]:
    """Mistakes in the URDF of a hand whose manifest may be refused before the URDF is read."""
    try:
        path = urdf_of(folder, read_yaml_mapping(folder / MANIFEST))
        if path is not None:
            read_urdf(path)
    except GdgError as mistake:
        return _messages(mistake)
    return []


def _further_findings(folder: Path) -> list[Finding]:
    """What else is wrong with a refused hand, as far as it can be loaded with a mended manifest."""
    mended = mend(folder)
    if mended is None:
        return []
    found = [error("", message) for message in mended.mistakes]
    try:
        hand = mended.load()
        case = HandCase(hand, model_of(hand, SURFACE_POINTS))
    except GdgError as mistake:
        return found + [error("", message) for message in _messages(mistake)]
    checks = [check for check in CHECKS if mended.may_run(check)]
    return found + [finding for finding in findings_of(case, checks) if mended.stands(finding)]


def _messages(mistake: GdgError) -> list[str]:
    return list(mistake.messages) if isinstance(mistake, GdgErrors) else [str(mistake)]


def findings_of(
    case: HandCase, checks: Sequence[Check[HandCase, Finding]] = CHECKS
) -> list[Finding]:
    """All findings on a loaded hand, errors first."""
    found = [
        finding
        for check in checks
        for finding in attempt(check, case, lambda text: error("", text))
    ]
    return _errors_first(dict.fromkeys(found))


def _errors_first(findings: Iterable[Finding]) -> list[Finding]:
    return sorted(findings, key=lambda finding: finding.severity != "error")
