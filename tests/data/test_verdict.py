"""Verdicts: what they say of trials that ran, and of those that did not."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gdg.data.verdict import Verdict, left_out_of, stable_share


def verdict(passed: tuple[bool, ...], trials: int = 0) -> Verdict:
    success = sum(passed) > len(passed) / 2
    return Verdict(
        success=success,
        failure="" if success else "moved",
        displacement_m=(0.001, 0.002, 0.003, math.nan, math.nan, math.nan),
        rotation_rad=(0.0, 0.0, 0.0, math.nan, math.nan, math.nan),
        drift_m=0.0,
        contact_kept=(True, True, True, False, False, False),
        penetration_start_mm=0.0,
        penetration_end_mm=0.0,
        free_displacement_m=0.25,
        shift_successes=passed,
        protocol="dro-2024-v1",
        engine="test",
        refined=True,
        seconds=0.1,
        trials=trials,
    )


@pytest.mark.parametrize("trials", [0, 3])
def test_stable_says_whether_all_trials_agree(trials: int):
    assert verdict((True, True, True), trials).stable is True
    assert verdict((True, False, True), trials).stable is False


def test_agreement_of_some_trials_leaves_stability_open():
    early = verdict((True, True, True), trials=5)
    assert early.decided_early
    assert early.stable is None
    assert verdict((True, False, True, True), trials=5).stable is False


def test_stable_share_is_known_only_where_all_trials_ran():
    firm, split, early = (
        verdict((True,) * 3, 3), verdict((True, True, False), 3), verdict((True, True), 3),
    )  # fmt: skip
    assert stable_share([firm, split]) == 0.5
    # trials that stop when they are decided only all run where they disagree
    assert math.isnan(stable_share([split, early]))
    assert math.isnan(stable_share([]))


@given(passed=st.lists(st.booleans(), min_size=1, max_size=5), more=st.integers(0, 4))
def test_verdicts_survive_json(passed: list[bool], more: int):
    written = verdict(tuple(passed), len(passed) + more)
    read = Verdict.from_dict(json.loads(json.dumps(written.as_dict())))
    assert repr(read) == repr(written)


def test_verdicts_written_without_trials_count_as_complete():
    tree = verdict((True, True, True), 3).as_dict()
    del tree["trials"]
    old = Verdict.from_dict(tree)
    assert not old.decided_early
    assert old.stable is True


def test_verdicts_written_before_lifts_were_read_as_ones_without():
    tree = verdict((True,), 1).as_dict()
    for name in ("lift_displacement_m", "lift_rotation_rad", "lift_contact", "left_out"):
        del tree[name]
    old = Verdict.from_dict(tree)
    assert math.isnan(old.lift_displacement_m)
    assert math.isnan(old.lift_rotation_rad)
    assert (old.lift_contact, old.left_out) == (False, ())
    assert repr(old) == repr(verdict((True,), 1))


def test_what_engines_leave_out_is_told_once_in_order():
    some = [replace(verdict((True,), 1), left_out=said) for said in (("b", "a"), (), ("a", "c"))]
    assert left_out_of(some) == ("b", "a", "c")
    assert left_out_of([]) == ()
