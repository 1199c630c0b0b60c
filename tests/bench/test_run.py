"""A table is an evaluation: resumed, shared, and never stopped by a row that can't be had."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from bench_weights import write_row_weights
from evaluation_fakes import FakePlanner
from PIL import Image

from gdg.bench.output import HEADER, markdown, table_rows, write_bench
from gdg.bench.recipes import train_command
from gdg.bench.run import run_bench
from gdg.bench.tables import BenchTable, Claim, Method, Published
from gdg.errors import GdgError
from gdg.hands.hand import find_hand
from gdg.identity import body_hash

#: What makes any table quick.
WORDS = ("simulator=fake", "hand_model.surface_points=60", "workers=1", "n=6")
TWO = "object=cube_small,cube_medium"


def words(tmp_path: Path, *more: str) -> list[str]:
    return [*WORDS, TWO, f"out={tmp_path / 'out'}", *more]


def test_a_table_has_ours_beside_theirs(table: BenchTable, tmp_path: Path):
    bench = run_bench(table, words(tmp_path))
    first, second = bench.rows
    assert first.row.success.n == 12
    assert second.row.success.n == 4  # two per object at most
    assert first.row.protocol == "gendexgrasp-2022-v1"
    assert [claim.verdict for claim in bench.claims] == ["confirmed", "refuted"]
    lines = table_rows(bench)
    assert all(len(line) == len(HEADER) for line in lines)
    assert lines[0][HEADER.index("published")] == "70.0"
    for part in (
        "A small table",
        "two_jaws (a hand folder of GDG_HANDS_PATH)",
        "grasps: 6 per object",
    ):
        assert part in bench.caption


def test_everything_is_written(table: BenchTable, tmp_path: Path):
    bench = run_bench(table, words(tmp_path))
    page, sheet, tree, picture = write_bench(bench)
    assert page.read_text() == markdown(bench)
    assert "- CONFIRMED: the first is not much worse" in page.read_text()
    with sheet.open(newline="") as stream:
        lines = list(csv.DictReader(stream))
    assert [line["method"] for line in lines] == ["first", "second"]
    assert lines[0]["published_success"] == "70.0"
    assert lines[0]["success_n"] == "12"
    known = json.loads(tree.read_text())
    assert known["rows"][0]["ours"]["success"]["n"] == 12
    with Image.open(picture) as image:
        assert image.width > 800


def test_a_second_run_computes_nothing(
    table: BenchTable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    before = markdown(run_bench(table, words(tmp_path)))
    monkeypatch.setattr(FakePlanner, "plan", None)
    assert markdown(run_bench(table, words(tmp_path))) == before


def test_tables_share_what_they_have_in_common(
    table: BenchTable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    run_bench(table, words(tmp_path))
    monkeypatch.setattr(FakePlanner, "plan", None)
    other = replace(table, name="other", methods=table.methods[:1], claims=())
    assert run_bench(other, words(tmp_path)).rows[0].row is not None


def test_cells_repeat_by_gdg_eval(table: BenchTable, tmp_path: Path):
    from gdg.cli.settings import configs_from
    from gdg.evaluation.cell import Cell, stored
    from gdg.pipeline.jobs import DEFAULTS, EvalJob

    run_bench(table, words(tmp_path))
    for path in (tmp_path / "out" / "cells").rglob("config.yaml"):
        (config,) = configs_from(EvalJob, DEFAULTS, (path,), ())
        assert stored(Cell.of(config, tmp_path / "out")) is not None


def test_protocols_and_refinement_make_further_rows(table: BenchTable, tmp_path: Path):
    bench = run_bench(table, words(tmp_path, "refine=false,true"))
    assert [row.settings for row in bench.rows] == ["refine=False", "refine=True"] * 2
    assert [claim.settings for claim in bench.claims] == ["refine=False", "refine=True"] * 2
    assert all(claim.verdict != "not tested" for claim in bench.claims)


def test_missing_weights_are_told_with_the_command_that_trains_them(
    table: BenchTable, tmp_path: Path
):
    ours = Method(
        "ours", "two_jaws", ("planner=contact-map", "distance=euclidean"), Published(1.0),
        weights="euclidean-without-nobody", distance="euclidean",
    )  # fmt: skip
    regressed = Method(
        "regressed", "two_jaws", ("planner=other",), Published(1.0), planner_weights=True
    )
    claims = (Claim("so it is", "success", "first", "ours"),)
    wider = replace(table, methods=(*table.methods, ours, regressed), claims=claims)
    bench = run_bench(wider, words(tmp_path))
    first, _, *missing = bench.rows
    assert first.row is not None
    for row, method, name in zip(missing, (ours, regressed), ("flow", "other"), strict=True):
        assert row.row is None
        assert not row.failed
        assert row.note == f"weights missing: {train_command(method, name)}"
    assert "distance=euclidean split=paper-without-nobody exclude_hand=nobody" in missing[0].note
    assert "planner=other hand=two_jaws" in missing[1].note
    assert [claim.verdict for claim in bench.claims] == ["not tested"]
    write_bench(bench)
    assert "weights missing: gdg train" in markdown(bench)


@pytest.mark.parametrize("place", ["{}.safetensors", "{}/model.safetensors"])
def test_weights_are_found_in_the_users_folder(table: BenchTable, tmp_path: Path, place: str):
    regressed = replace(table.methods[1], planner_weights=True)
    path = tmp_path / "weights" / place.format("other-two_jaws")
    body = body_hash(find_hand("two_jaws"))
    write_row_weights(path, hands=["two_jaws"], held_out_hands=[], hand_body=body)
    wider = replace(table, methods=(table.methods[0], regressed), claims=())
    bench = run_bench(wider, words(tmp_path, f"weights={tmp_path / 'weights'}"))
    assert bench.rows[1].row is not None
    (used,) = bench.weights
    assert (used.path, used.said["train_objects"]) == (path, ["banana"])
    assert f"Weights: other-two_jaws ({used.sha256[:12]})." in bench.caption
    told = [p.read_text() for p in (tmp_path / "out" / "cells").rglob("config.yaml")]
    assert sum(str(path) in text for text in told) == 2


def test_refused_weights_leave_the_row_empty_and_are_no_failure(table: BenchTable, tmp_path: Path):
    regressed = replace(table.methods[1], planner_weights=True)
    write_row_weights(tmp_path / "weights" / "other-two_jaws.safetensors")
    wider = replace(table, methods=(table.methods[0], regressed))
    bench = run_bench(wider, words(tmp_path, f"weights={tmp_path / 'weights'}"))
    first, second = bench.rows
    assert first.row is not None
    assert second.row is None
    assert not second.failed
    assert second.note.startswith("weights refused: ")
    assert bench.weights == ()
    assert {claim.verdict for claim in bench.claims} == {"not tested"}


def test_settings_of_the_user_s_don_t_change_what_is_fixed_in_a_row(
    table: BenchTable, tmp_path: Path
):
    fixed = replace(table.methods[0], fixed=("fitter",), quick=("fitter.steps=7",))
    wider = replace(table, methods=(fixed, table.methods[1]), claims=())
    given = [word for word in WORDS if not word.startswith("n=")]
    file = tmp_path / "settings.yaml"
    file.write_text("fitter: {particles: 5}")
    run_bench(wider, [*given, f"out={tmp_path}", "fitter.steps=9"], [file], quick=True)
    told = [p.read_text() for p in (tmp_path / "cells").rglob("config.yaml")]
    fitters = {
        tree["planner"]["name"]: (tree["fitter"]["steps"], tree["fitter"]["particles"])
        for tree in map(yaml.safe_load, told)
    }
    assert len(told) == 4
    # quick gives the second row 8 particles, over those of the file
    assert fitters == {"fake": (7, 64), "other": (9, 8)}


def test_a_row_that_the_paper_does_not_have_has_dashes(table: BenchTable, tmp_path: Path):
    ours = replace(table.methods[1], published=None)
    bench = run_bench(replace(table, methods=(ours,), claims=()), words(tmp_path))
    (cells,) = table_rows(bench)
    for title in ("published", "ours − published", "published s"):
        assert cells[HEADER.index(title)] == "–"
    _, sheet, tree, _ = write_bench(bench)
    with sheet.open(newline="") as stream:
        (line,) = csv.DictReader(stream)
    assert line["published_success"] == ""
    assert json.loads(tree.read_text())["rows"][0]["method"]["published"] is None


def test_ours_minus_published_has_the_interval_over_objects(table: BenchTable, tmp_path: Path):
    bench = run_bench(replace(table, claims=()), words(tmp_path))
    row = bench.rows[0].row
    assert row is not None
    low, high = (100 * min(1.0, max(0.0, share)) - 70 for share in row.macro[1:])
    shown = table_rows(bench)[0][HEADER.index("ours − published")]
    assert shown == f"{100 * row.success.share - 70:+.0f} ({low:+.0f} to {high:+.0f})"


def test_a_planner_that_is_not_there_is_told(table: BenchTable, tmp_path: Path):
    method = Method("lost", "two_jaws", ("planner=nowhere",), Published(1.0))
    bench = run_bench(replace(table, methods=(method,), claims=()), words(tmp_path))
    assert "planner missing: Unknown planner 'nowhere'" in bench.rows[0].note


def test_a_row_that_fails_leaves_the_others(table: BenchTable, tmp_path: Path):
    broken = Method(
        "broken", "two_jaws", ("planner=fake", "planner.broken=mistake"), Published(1.0)
    )
    methods = (table.methods[0], broken)
    bench = run_bench(replace(table, methods=methods, claims=()), words(tmp_path))
    assert bench.rows[0].row is not None
    assert bench.rows[1].failed
    assert "this planner gives up" in bench.rows[1].note


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("hand=allegro", "hand: is set by the table"),
        ("planner.top=3", "planner.top: is set by the table"),
        ("n=1,2", "n: takes one value here"),
        ("fiter.steps=3", "Did you mean"),
        ("object=cube_smal", "Did you mean 'cube_small'"),
        ("weights=nowhere", "there is no such folder"),
    ],
)
def test_mistakes_are_told(table: BenchTable, tmp_path: Path, word: str, said: str):
    methods = (table.methods[0], replace(table.methods[1], planner_weights=True))
    wider = replace(table, methods=methods, claims=())
    with pytest.raises(GdgError, match=said):
        run_bench(wider, words(tmp_path, word))


def test_quick_is_small_and_says_so(table: BenchTable, tmp_path: Path):
    given = [word for word in WORDS if not word.startswith("n=")]
    bench = run_bench(table, [*given, f"out={tmp_path}"], quick=True)
    assert bench.rows[0].row.success.n == 4  # two grasps on two objects
    assert bench.caption.startswith("QUICK")
    assert "2 bundled test objects" in bench.caption
