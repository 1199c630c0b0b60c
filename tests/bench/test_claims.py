"""Claims are judged by intervals, and by nothing else."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gdg.bench.claims import judge
from gdg.bench.tables import Claim
from gdg.evaluation.rows import ObjectRow, Row
from gdg.evaluation.spread import Spread
from gdg.metrics import Rate, wilson_interval

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


def rates(*successes: int, n: int = 20) -> Row:
    """A row of objects with so many successes of ``n``."""
    return row(objects=tuple(
        ObjectRow(f"o{i}", Rate(k, n), math.nan, 1.0) for i, k in enumerate(successes)
    ))  # fmt: skip


HALF = (9, 10, 11, 10, 10, 9, 11, 10)
MOST = (18, 17, 19, 18, 18, 17, 19, 18)


@pytest.mark.parametrize(
    ("first", "second", "margin", "verdict"),
    [
        (MOST, HALF, 0.0, "confirmed"),
        (HALF, MOST, 0.0, "refuted"),
        (HALF, HALF[::-1], 0.0, "undecided"),
        (HALF, HALF[::-1], -0.2, "confirmed"),
        (HALF, MOST, -0.05, "refuted"),
        (MOST, HALF, 0.6, "refuted"),
    ],
)
def test_success_is_judged_by_differences_object_by_object(first, second, margin, verdict):
    found = judge(claim(margin=margin), [(rates(*first), rates(*second))])
    assert found.verdict == verdict
    assert found.estimate == pytest.approx((sum(first) - sum(second)) / 160)
    assert verdict.upper() in found.sentence
    assert "points" in found.sentence


def test_grasps_of_one_object_are_not_counted_as_independent():
    # 240 of 400 against 160 of 400 would be sure, were it not two objects that make it
    first, second = rates(100, 20, 20, 100, n=100), rates(20, 100, 20, 20, n=100)
    assert wilson_interval(240, 400)[0] > wilson_interval(160, 400)[1]
    assert judge(claim(), [(first, second)]).verdict == "undecided"


def test_equal_differences_are_no_certainty():
    # two objects, one grasp each: 100 % against none
    found = judge(claim(), [(rates(1, 1, n=1), rates(0, 0, n=1))])
    assert found.verdict == "undecided"
    assert found.interval[0] < 0 < found.interval[1]
    # ten objects, 64 grasps each, all of them
    assert (
        judge(claim(), [(rates(*[64] * 10, n=64), rates(*[0] * 10, n=64))]).verdict == "confirmed"
    )
    assert judge(claim(), [(rates(*HALF), rates(*HALF))]).verdict == "undecided"


@pytest.mark.parametrize("measure", ["success", "diversity", "speed"])
def test_fewer_than_two_objects_decide_nothing(measure: str):
    for count in (0, 1):
        best, worst = (
            row(objects=tuple(ObjectRow(f"o{i}", Rate(k, 100), d, s) for i in range(count)))
            for k, d, s in ((100, 0.9, 0.1), (0, 0.1, 99.0))
        )
        found = judge(claim(measure), [(best, worst)])
        assert found.verdict == "undecided"
        assert "object on which both are known" in found.sentence


@given(st.lists(st.tuples(st.integers(0, 8), st.integers(0, 8)), min_size=2, max_size=10))
def test_a_verdict_turns_with_its_sides(counts: list[tuple[int, int]]):
    first, second = (rates(*ks, n=8) for ks in zip(*counts, strict=True))
    found, turned = judge(claim(), [(first, second)]), judge(claim(), [(second, first)])
    opposite = {"confirmed": "refuted", "refuted": "confirmed", "undecided": "undecided"}
    assert turned.verdict == opposite[found.verdict]
    low, high = found.interval
    assert low < found.estimate < high
    assert turned.interval == pytest.approx((-high, -low))


def objects(*values: tuple[float, float]) -> tuple[ObjectRow, ...]:
    return tuple(ObjectRow(f"o{i}", ANY, d, s) for i, (d, s) in enumerate(values))


def test_diversity_is_judged_object_by_object():
    wide = row(objects=objects((0.3, 1), (0.35, 1), (0.32, 1), (math.nan, 1)))
    narrow = row(objects=objects((0.1, 1), (0.12, 1), (0.13, 1), (0.9, 1)))
    found = judge(claim("diversity"), [(wide, narrow)])
    assert found.verdict == "confirmed"
    assert found.estimate == pytest.approx((0.2 + 0.23 + 0.19) / 3)
    assert judge(claim("diversity"), [(narrow, wide)]).verdict == "refuted"


def test_an_interval_without_width_decides_nothing():
    wide, narrow = (row(objects=objects((d, 1), (d, 1), (d, 1))) for d in (0.5, 0.25))
    assert judge(claim("diversity"), [(wide, narrow)]).verdict == "undecided"


def test_speed_is_judged_as_a_ratio():
    slow = row(objects=objects((0, 1000.0), (0, 1500.0), (0, 900.0)))
    quick = row(objects=objects((0, 1.0), (0, 1.1), (0, 0.8)))
    found = judge(claim("speed", math.log(100)), [(quick, slow)])
    assert found.verdict == "confirmed"
    assert "times as fast" in found.sentence
    assert judge(claim("speed", math.log(1e5)), [(quick, slow)]).verdict == "refuted"


def test_a_claim_about_a_missing_row_is_not_tested():
    found = judge(claim(), [(None, row())])
    assert found.verdict == "not tested"
    assert "a row is missing" in found.sentence


def test_several_pairs_of_rows_are_judged_together():
    small, large = (8, 9, 10, 9), (10, 10, 10, 11)  # too few objects to tell alone
    alone = judge(claim(), [(rates(*large), rates(*small))])
    together = judge(claim(), [(rates(*large), rates(*small))] * 6)
    assert together.estimate == pytest.approx(alone.estimate)
    widths = [high - low for low, high in (alone.interval, together.interval)]
    assert widths[1] < widths[0]
    half = judge(claim(), [(rates(*large), rates(*small)), (rates(*small), rates(*small))])
    assert half.estimate == pytest.approx(alone.estimate / 2)
    assert judge(claim(), [(rates(*large), rates(*small)), (row(), None)]).verdict == "not tested"
