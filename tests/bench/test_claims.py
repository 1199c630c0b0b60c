"""Claims are judged by intervals, and by nothing else."""

from __future__ import annotations

import math
from typing import Any

import pytest

from gdg.bench.claims import judge
from gdg.bench.tables import Claim
from gdg.evaluation.rows import ObjectRow, Row
from gdg.evaluation.spread import Spread
from gdg.metrics import Rate

ANY = Rate(1, 2)


def row(k: int = 1, n: int = 2, objects: tuple[ObjectRow, ...] = ()) -> Row:
    names = ("penetration_mm", "quality", "seconds", "failures", "rejected")
    rest: dict[str, Any] = {name: {} for name in names}
    spread = Spread(math.nan, math.nan, 0, 0.0, 0)
    return Row(
        {}, "p-v1", (), "8", 1, Rate(k, n), (k / n, 0.0, 1.0), Rate(k, n), 1.0, ANY, ANY, spread,
        objects=objects, **rest,
    )  # fmt: skip


def claim(measure: str = "success", margin: float = 0.0) -> Claim:
    return Claim("better", measure, "a", "b", margin)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("first", "second", "margin", "verdict"),
    [
        (90, 50, 0.0, "confirmed"),
        (50, 90, 0.0, "refuted"),
        (52, 50, 0.0, "undecided"),
        (48, 50, -0.2, "confirmed"),
        (48, 50, -0.05, "undecided"),
        (40, 80, -0.05, "refuted"),
        (90, 50, 0.6, "refuted"),
    ],
)
def test_success_is_judged_by_the_interval_of_the_difference(first, second, margin, verdict):
    found = judge(claim(margin=margin), row(first, 100), row(second, 100))
    assert found.verdict == verdict
    assert found.estimate == pytest.approx((first - second) / 100)
    assert verdict.upper() in found.sentence
    assert "points" in found.sentence


def objects(*values: tuple[float, float]) -> tuple[ObjectRow, ...]:
    return tuple(ObjectRow(f"o{i}", ANY, d, s) for i, (d, s) in enumerate(values))


def test_diversity_is_judged_object_by_object():
    wide = row(objects=objects((0.3, 1), (0.35, 1), (0.32, 1), (math.nan, 1)))
    narrow = row(objects=objects((0.1, 1), (0.12, 1), (0.13, 1), (0.9, 1)))
    found = judge(claim("diversity"), wide, narrow)
    assert found.verdict == "confirmed"
    assert found.estimate == pytest.approx((0.2 + 0.23 + 0.19) / 3)
    assert judge(claim("diversity"), narrow, wide).verdict == "refuted"
    one = row(objects=objects((0.3, 1)))
    assert judge(claim("diversity"), one, narrow).verdict == "undecided"


def test_speed_is_judged_as_a_ratio():
    slow = row(objects=objects((0, 1000.0), (0, 1500.0), (0, 900.0)))
    quick = row(objects=objects((0, 1.0), (0, 1.1), (0, 0.8)))
    found = judge(claim("speed", math.log(100)), quick, slow)
    assert found.verdict == "confirmed"
    assert "times as fast" in found.sentence
    assert judge(claim("speed", math.log(1e5)), quick, slow).verdict == "refuted"


def test_a_claim_about_a_missing_row_is_not_tested():
    found = judge(claim(), None, row())
    assert found.verdict == "not tested"
    assert "a row is missing" in found.sentence
