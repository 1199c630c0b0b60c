"""Simulators are compared grasp by grasp."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from grasp_samples import make_verdict

from gdg.evaluation.agreement import Confusion, agreement_lines
from gdg.evaluation.run import run_cells, run_eval

ONE = "object=cube_small"


def verdicts(*answers: str):
    """Pairs of verdicts: ``yn`` for a yes of the first and a no of the second."""
    return [(make_verdict(a == "y"), make_verdict(b == "y")) for a, b in answers]


def test_a_confusion_matrix_counts_pairs():
    matrix = Confusion.of(verdicts("yy", "yy", "yn", "ny", "ny", "ny", "nn"))
    assert (matrix.both, matrix.only_first, matrix.only_second, matrix.neither) == (2, 1, 3, 1)
    assert (matrix.same.k, matrix.same.n) == (3, 7)
    # by hand: chance agreement (3*5 + 4*2)/49 = 23/49
    assert matrix.kappa == pytest.approx((3 / 7 - 23 / 49) / (1 - 23 / 49))
    # one of four differences, two-sided: 2 (1 + 4) / 16
    assert matrix.p_value == pytest.approx(10 / 16)


def test_perfect_agreement_has_kappa_one_and_nothing_to_test():
    matrix = Confusion.of(verdicts("yy", "nn", "nn"))
    assert (matrix.kappa, matrix.p_value) == (1.0, 1.0)
    assert math.isnan(Confusion.of(verdicts("yy", "yy")).kappa)


def test_two_settings_of_one_simulator_are_compared_on_the_same_grasps(configs, tmp_path: Path):
    grid = configs(ONE, "n=30", "simulator.below=0.5,0.9")
    done = run_eval(grid)
    (agreement,) = done.agreements
    assert (agreement.first, agreement.second) == ("fake below=0.5", "fake below=0.9")
    results, _ = run_cells(grid)
    x = results[0].grasps.poses[:, 0, 3]
    matrix = agreement.matrix
    assert matrix.both == int((x < 0.5).sum())
    assert matrix.only_second == int(((x >= 0.5) & (x < 0.9)).sum())
    assert matrix.only_first == 0
    assert matrix.neither == int((x >= 0.9).sum())
    # all but those that pass barely
    barely = [(x < limit) & (x > limit - 0.1) for limit in (0.5, 0.9)]
    assert agreement.stable.same.n == 30 - int((barely[0] | barely[1]).sum()) < 30
    assert sum(count for *_, count in agreement.outcomes) == 30
    assert {"pass", "moved"} <= {first for first, *_ in agreement.outcomes}
    (tree,) = json.loads((tmp_path / "out" / "agreement.json").read_text())
    assert tree["matrix"]["only_second"] == matrix.only_second
    text = (tmp_path / "out" / "agreement.md").read_text()
    assert "| fake below=0.5 passes |" in text
    assert "kappa" in "\n".join(agreement_lines(agreement))


def test_settings_are_compared_apart_and_together(configs):
    done = run_eval(configs(ONE, "n=4", "simulator.below=0.5,0.9", "refine=false,true"))
    assert [a.where for a in done.agreements] == ["all", "refine=False", "refine=True"]
    assert [a.matrix.same.n for a in done.agreements] == [8, 4, 4]


def test_three_simulators_make_three_pairs(configs):
    done = run_eval(configs(ONE, "n=2", "simulator.below=0.5,0.7,0.9"))
    assert len({(a.first, a.second) for a in done.agreements}) == 3


def test_one_simulator_is_compared_with_nothing(configs):
    assert run_eval(configs(ONE, "n=2", "refine=false,true")).agreements == []
