"""What a command gave back, and what every refusal looks like."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Outcome:
    """What a command gave back."""

    code: int
    out: str
    err: str

    @property
    def errors(self) -> list[str]:
        """The lines that begin with ``Error: ``."""
        return [line for line in self.err.splitlines() if line.startswith("Error: ")]


def refused(outcome: Outcome, *parts: str) -> None:
    """Exit code 2, one line of error that holds the parts, no traceback, nothing on stdout."""
    assert outcome.code == 2
    assert len(outcome.errors) == 1, outcome.err
    assert "Traceback" not in outcome.err
    assert outcome.out == ""
    for part in parts:
        assert part in outcome.errors[0]
