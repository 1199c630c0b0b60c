"""What becomes of the paper's claims, judged object by object by 95 % intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gdg.bench.tables import Claim
from gdg.evaluation.rows import ObjectRow, Row
from gdg.metrics import chance_error, mean_interval


@dataclass(frozen=True)
class ClaimVerdict:
    """What the numbers say of a claim.

    Attributes:
        claim: the claim.
        verdict: ``confirmed``: the whole interval lies above the claim's margin; ``refuted``: all
            of it lies below; ``undecided``; ``not tested``: a row is missing.
        estimate: of the first row over the second, mean over objects, in the measure's unit.
        interval: of the estimate; NaN for fewer than two objects.
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
    """Compares two rows, object by object.

    What is judged is the mean, over the objects that both rows have, of the difference of success
    shares, of the difference of diversities, or of the logarithm of the ratio of seconds, by its
    Student t interval over objects. Grasps of one object succeed and fail together, so counting
    all of a row as independent, as Wilson's interval of the row does, would be too sure; and both
    rows have the same objects, easy and hard ones, which the pairing takes out.

    Differences of success may be equal by chance, all of a few objects at 100 % for instance. The
    interval is therefore at least as wide as grasps that were independent would make it. An
    interval without any width (or of fewer than two objects) decides nothing.
    """
    if first is None or second is None:
        return ClaimVerdict(claim, "not tested", settings=settings)
    others = {one.name: one for one in second.objects}
    pairs = [(one, others[one.name]) for one in first.objects if one.name in others]
    differences = _differences(claim, pairs)
    estimate = sum(differences) / len(differences) if differences else math.nan
    sides = ([one.success for one, _ in pairs], [other.success for _, other in pairs])
    chance = math.hypot(*map(chance_error, sides)) if claim.measure == "success" else 0.0
    low, high = mean_interval(differences, chance)
    verdict = "undecided"
    if low < high and low > claim.margin:
        verdict = "confirmed"
    elif low < high < claim.margin:
        verdict = "refuted"
    return ClaimVerdict(claim, verdict, estimate, (low, high), settings)


#: An object of one row and the same of another.
_Pair = tuple[ObjectRow, ObjectRow]


def _differences(claim: Claim, pairs: Sequence[_Pair]) -> list[float]:
    """First over second, for each object on which both are known."""
    if claim.measure == "success":
        values = [one.success.share - other.success.share for one, other in pairs]
    elif claim.measure == "diversity":
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
    if math.isnan(low):
        return "one object on which both are known"
    if claim.measure == "success":
        low, high = max(low, -1.0), min(high, 1.0)
        return f"{100 * estimate:+.1f} points, 95 % {100 * low:+.1f} to {100 * high:+.1f}"
    if claim.measure == "diversity":
        return f"{estimate:+.3f} rad, 95 % {low:+.3f} to {high:+.3f}"
    return f"{_times(estimate)} as fast, 95 % {_times(low)} to {_times(high)}"


def _times(logarithm: float) -> str:
    return f"{math.exp(logarithm):.3g} times"
