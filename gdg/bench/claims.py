"""What becomes of the paper's claims: confirmed, refuted or undecided, by 95 % intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gdg.bench.tables import Claim
from gdg.evaluation.rows import Row
from gdg.metrics import mean_interval, newcombe_interval


@dataclass(frozen=True)
class ClaimVerdict:
    """What the numbers say of a claim.

    Attributes:
        claim: the claim.
        verdict: ``confirmed``: the whole interval lies above the claim's margin; ``refuted``: all
            of it lies below; ``undecided``; ``not tested``: a row is missing.
        estimate: of the first row over the second, in the measure's unit.
        interval: of the estimate.
        settings: of the rows, where the table has several protocols or the like.
    """

    claim: Claim
    verdict: str
    estimate: float = math.nan
    interval: tuple[float, float] = (math.nan, math.nan)
    settings: str = ""

    @property
    def sentence(self) -> str:
        """One line for people."""
        where = f" [{self.settings}]" if self.settings else ""
        text = f"{self.verdict.upper()}: {self.claim.text}{where}"
        if self.verdict == "not tested":
            return f"{text} (a row is missing)."
        return f"{text} ({shown(self.claim, self.estimate, self.interval)})."


def judge(claim: Claim, first: Row | None, second: Row | None, settings: str = "") -> ClaimVerdict:
    """Compares two rows.

    Success: difference of two shares, Newcombe's interval. Diversity and speed: mean over the
    objects that both rows have, Student's t interval, speed as the logarithm of the ratio.
    """
    if first is None or second is None:
        return ClaimVerdict(claim, "not tested", settings=settings)
    if claim.measure == "success":
        estimate = first.success.share - second.success.share
        low, high = newcombe_interval(first.success, second.success)
    else:
        differences = _differences(claim, first, second)
        estimate = sum(differences) / len(differences) if differences else math.nan
        low, high = mean_interval(differences)
    verdict = "undecided"
    if low > claim.margin:
        verdict = "confirmed"
    elif high < claim.margin:
        verdict = "refuted"
    return ClaimVerdict(claim, verdict, estimate, (low, high), settings)


def _differences(claim: Claim, first: Row, second: Row) -> list[float]:
    """First over second, for each object that both have and where both are known."""
    others = {one.name: one for one in second.objects}
    pairs = [(one, others[one.name]) for one in first.objects if one.name in others]
    if claim.measure == "diversity":
        values = [one.diversity_rad - other.diversity_rad for one, other in pairs]
    else:
        values = [
            math.log(other.plan_s / one.plan_s)
            for one, other in pairs
            if one.plan_s > 0 and other.plan_s > 0
        ]
    return [value for value in values if math.isfinite(value)]


def shown(claim: Claim, estimate: float, interval: tuple[float, float]) -> str:
    """Estimate and interval in words."""
    low, high = interval
    if math.isnan(estimate):
        return "no object on which both are known"
    if claim.measure == "success":
        return f"{100 * estimate:+.1f} points, 95 % {100 * low:+.1f} to {100 * high:+.1f}"
    if claim.measure == "diversity":
        return f"{estimate:+.3f} rad, 95 % {low:+.3f} to {high:+.3f}"
    return f"{_times(estimate)} as fast, 95 % {_times(low)} to {_times(high)}"


def _times(logarithm: float) -> str:
    return f"{math.exp(logarithm):.3g} times"
