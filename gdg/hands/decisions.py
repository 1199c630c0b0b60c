"""What was decided about a new hand, and how sure that is. Light."""

from __future__ import annotations

from dataclasses import dataclass

#: From here on a decision counts as sure; below the second figure someone should look at it.
SURE, DOUBTFUL = 0.9, 0.6


@dataclass(frozen=True)
class Decision:
    """One field of a manifest that a program chose, for a person to confirm.

    Attributes:
        subject: what was decided, as the manifest calls it, e.g. ``palm.normal``.
        value: what was chosen, as text.
        confidence: how sure it is, from 0 to 1.
        reason: why, in one sentence.
    """

    subject: str
    value: str
    confidence: float
    reason: str

    def __post_init__(self) -> None:
        if not 0.0 <= self.confidence <= 1.0:
            raise ValueError(f"confidence {self.confidence} is not between 0 and 1")

    @property
    def verdict(self) -> str:
        """``sure``, ``likely`` or ``look at this``."""
        if self.confidence >= SURE:
            return "sure"
        return "likely" if self.confidence >= DOUBTFUL else "look at this"
