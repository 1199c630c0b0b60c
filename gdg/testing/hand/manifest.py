"""Checks of a hand's name and provenance."""

from __future__ import annotations

from collections.abc import Iterator

from gdg.testing.findings import Finding, error, warning
from gdg.testing.hand.case import HandCase

#: Words in place of a licence that say that there is none to go by.
UNKNOWN_LICENCE = ("unknown", "not stated", "unspecified", "none", "todo", "tbd", "?")


def name(case: HandCase) -> Iterator[Finding]:
    """The folder and the hand bear one name: the folder's is typed, the hand's is in the files."""
    spec, folder = case.hand.spec, case.hand.folder.resolve()
    if spec.name != folder.name:
        yield error(
            case.in_manifest("name"),
            f"is '{spec.name}', but the folder is called '{folder.name}'; rename one of them.",
        )
    if not spec.title.strip():
        yield warning(
            case.in_manifest("title"), "is empty; write the name that people know the hand by."
        )


def provenance(case: HandCase) -> Iterator[Finding]:
    """Source and licence are named."""
    given = case.hand.spec.provenance
    if not given.source.strip():
        yield error(
            case.in_manifest("provenance.source"), "is empty; write where the figures come from."
        )
    licence = given.licence.strip().lower()
    if not licence:
        yield error(
            case.in_manifest("provenance.licence"),
            "is empty; write the licence of the description, or 'not stated' if it has none.",
        )
    elif licence.rstrip(".") in UNKNOWN_LICENCE:
        yield warning(
            case.in_manifest("provenance.licence"),
            f"is '{given.licence.strip()}': nobody may pass this hand on before its owner says so.",
        )


CHECKS = (name, provenance)
