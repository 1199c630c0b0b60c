"""The paper's tables, as the command line knows them."""

from __future__ import annotations

import pytest

from gdg.bench.tables import HANDS, PUBLISHED, TABLES, find_table
from gdg.config import compose
from gdg.errors import GdgError
from gdg.pipeline.jobs import DEFAULTS, EvalJob
from gdg.registry import get_registry

ROWS = [method for table in TABLES.values() for method in table.methods]


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_claims_are_about_rows_of_the_table(table):
    labels = [method.label for method in table.methods]
    assert len(set(labels)) == len(labels)
    for claim in table.claims:
        assert {label for pair in claim.pairs for label in pair} <= set(labels)


def test_the_tables_hold_the_published_numbers():
    one = {m.label: m.published for m in TABLES["table1"].methods}
    assert (one["DFC"].success, one["DFC"].diversity_rad) == (79.53, 0.344)
    assert (one["DFC"].seconds, one["DFC"].at_least) == (1800.0, True)
    assert (one["GraspCVAE"].success, one["GraspCVAE"].seconds) == (19.38, 0.012)
    assert one["GraspCVAE, adapted"].success == 22.03
    assert [one[f"UniGrasp top-{k}"].success for k in (1, 8, 32)] == [80.0, 50.0, 48.4]
    assert (one[PUBLISHED].success, one[PUBLISHED].seconds) == (77.19, 16.4)
    assert one["gdg"] is None
    two = {m.label: m.published.success for m in TABLES["table2"].methods}
    assert two["barrett, aligned"] == 70.31
    assert two["ezgripper, euclidean"] == 29.53
    three = {m.label: m.published.success for m in TABLES["table3"].methods}
    assert (three["barrett, seen"], three["barrett, unseen"]) == (71.72, 70.31)


def test_unseen_hands_get_weights_that_never_saw_them():
    for method in ROWS:
        if method.planner == "contact-map":
            seen = method.label.endswith(", seen")
            ending = "full" if seen else f"without-{method.hand}"
            assert method.weights.endswith(ending)
            assert method.held_out == ("" if seen else method.hand)
            assert method.weights.startswith("euclidean") == (method.distance == "euclidean")
            assert f"distance={method.distance}" in method.words
    assert set(HANDS) == {"ezgripper", "barrett", "shadowhand"}


def test_the_paper_s_method_stands_beside_ours_in_its_own_settings():
    (ours,) = (m for m in TABLES["table1"].methods if m.label == "gdg")
    (theirs,) = (m for m in TABLES["table1"].methods if m.label == PUBLISHED)
    first, second = (
        compose(EvalJob, get_registry(), DEFAULTS, (), ["object=apple", "hand=allegro", *m.words])
        for m in (theirs, ours)
    )
    fitter, planner = (first[0].components[key].options for key in ("fitter", "planner"))
    assert (planner.rank, planner.close) == ("energy", False)
    # 100 times the mean depth, constant; an exact search in every step; the one of lowest energy
    assert (fitter.penetration, fitter.penetration_weight, fitter.penetration_ramp) == (
        "nearest", 1.0, 1.0,
    )  # fmt: skip
    assert (fitter.search_every, fitter.keep, fitter.self_weight) == (1, 1, 0.0)
    assert (fitter.particles, fitter.steps, fitter.learning_rate) == (32, 100, 5e-3)
    defaults = second[0].components
    assert defaults["fitter"].options == defaults["fitter"].record.options()
    assert defaults["planner"].options == defaults["planner"].record.options()


def test_an_unknown_table_gets_a_suggestion():
    with pytest.raises(GdgError, match="Did you mean 'table2'"):
        find_table("tabel2")
