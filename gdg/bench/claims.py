"""What becomes of the paper's claims, judged object by object by 95 % intervals."""

from __future__ import annotations

import itertools
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


#: A row and the one that it is compared with, None where it could not be had.
RowPair = tuple[Row | None, Row | None]
#: An object of one row and the same of another.
_Both = tuple[ObjectRow, ObjectRow]


def judge(claim: Claim, compared: Sequence[RowPair], settings: str = "") -> ClaimVerdict:
    """Compares rows, object by object.

    What is judged is the mean, over the objects that both rows have, of the difference of success
    shares, of the difference of diversities, or of the logarithm of the ratio of seconds, by its
    Student t interval over objects. Grasps of one object succeed and fail together, so counting
    all of a row as independent, as Wilson's interval of the row does, would be too sure; and both
    rows have the same objects, easy and hard ones, which the pairing takes out. Where a claim is
    about several pairs of rows, each object counts with the mean over them.

    Differences of success may be equal by chance, all of a few objects at 100 % for instance. The
    interval is therefore at least as wide as grasps that were independent would make it. An
    interval without any width (or of fewer than two objects) decides nothing.
    """
    matched = [_matched(first, second) for first, second in compared if first and second]
    if len(matched) < len(compared):
        return ClaimVerdict(claim, "not tested", settings=settings)
    differences = _differences(claim, matched)
    estimate = sum(differences) / len(differences) if differences else math.nan
    low, high = mean_interval(differences, _chance(claim, matched))
    verdict = "undecided"
    if low < high and low > claim.margin:
        verdict = "confirmed"
    elif low < high < claim.margin:
        verdict = "refuted"
    return ClaimVerdict(claim, verdict, estimate, (low, high), settings)


def _matched(first: Row, second: Row) -> list[_Both]:
    """The objects that both rows have."""
    others = {one.name: one for one in second.objects}
    return [(one, others[one.name]) for one in first.objects if one.name in others]


def _differences(claim: Claim, matched: Sequence[Sequence[_Both]]) -> list[float]:
    """First over second for each object on which both are known, means over the pairs of rows."""
    by_object: dict[str, list[float]] = {}
    for one, other in itertools.chain.from_iterable(matched):
        if math.isfinite(value := _difference(claim, one, other)):
            by_object.setdefault(one.name, []).append(value)
    return [sum(values) / len(values) for values in by_object.values()]


def _difference(claim: Claim, one: ObjectRow, other: ObjectRow) -> float:
    if claim.measure == "success":
        return one.success.share - other.success.share
    if claim.measure == "diversity":
        return one.diversity_rad - other.diversity_rad
    known = one.plan_s > 0 and other.plan_s > 0
    return math.log(other.plan_s / one.plan_s) if known else math.nan


def _chance(claim: Claim, matched: Sequence[Sequence[_Both]]) -> float:
    """Standard error of the mean difference of success if grasps were independent."""
    if claim.measure != "success":
        return 0.0
    sides = (([a.success for a, _ in both], [b.success for _, b in both]) for both in matched)
    errors = map(chance_error, itertools.chain.from_iterable(sides))
    return math.hypot(*errors) / max(1, len(matched))


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
