"""Checks of a hand folder, beyond what loading it refuses."""

from __future__ import annotations

import os
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
    return loaded if loaded.case is None else Inspection(findings_of(loaded.case), loaded.case)


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
        named = read_yaml_mapping(folder / MANIFEST).get("urdf")
        if not isinstance(named, str) or not named.isprintable():
            return []
        path = Path(os.path.realpath(folder / named))
        if path.is_relative_to(folder.resolve()) and os.path.isfile(path):
            read_urdf(path)
    except GdgError as mistake:
        return _messages(mistake)
    return []


def _messages(mistake: GdgError) -> list[str]:
    return list(mistake.messages) if isinstance(mistake, GdgErrors) else [str(mistake)]


def findings_of(case: HandCase) -> list[Finding]:
    """All findings on a loaded hand, errors first."""
    found = [
        finding
        for check in CHECKS
        for finding in attempt(check, case, lambda text: error("", text))
    ]
    return sorted(dict.fromkeys(found), key=lambda finding: finding.severity != "error")
