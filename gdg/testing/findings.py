"""What a check of a hand found: an error, or a doubt that a person should weigh. Light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Finding:
    """One thing that a check found.

    An ``error`` makes results wrong or a step fail: it must be mended. A ``warning`` is
    unusual or has a stand-in, which the text names: look at it, then mend or leave it.

    Attributes:
        severity: ``error`` or ``warning``.
        place: file and dotted field, e.g. ``hand.yaml: palm.normal``.
        text: what is wrong and what to do, in one sentence.
    """

    severity: Literal["error", "warning"]
    place: str
    text: str

    def __str__(self) -> str:
        return f"{self.place}: {self.text}" if self.place else self.text


def error(place: str, text: str) -> Finding:
    """Something that must be mended."""
    return Finding("error", place, text)


def warning(place: str, text: str) -> Finding:
    """Something to look at."""
    return Finding("warning", place, text)


def errors_in(findings: list[Finding]) -> list[Finding]:
    """The errors alone."""
    return [finding for finding in findings if finding.severity == "error"]
