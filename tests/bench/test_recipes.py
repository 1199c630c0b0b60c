"""The commands that train the tables' weights are whole: as printed, gdg train takes them."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from gdg.bench.recipes import HELD_OUT, RECIPES, train_command
from gdg.bench.tables import TABLES, Method
from gdg.cli.settings import configs_from
from gdg.cli.train import _defaults
from gdg.splits import load_split
from gdg.training.job import TrainJob

ROWS = {m.label: m for t in TABLES.values() for m in t.methods if m.weights or m.planner_weights}


def component(method: Method, generator: str) -> str:
    return method.planner if method.planner_weights else generator


@pytest.mark.parametrize("generator", ["cvae", "flow"])
@pytest.mark.parametrize("method", ROWS.values(), ids=ROWS)
def test_every_row_s_command_trains_what_the_row_needs(method: Method, generator: str):
    name = component(method, generator)
    program, command, *words = shlex.split(train_command(method, name))
    assert (program, command) == ("gdg", "train")
    (config,) = configs_from(TrainJob, _defaults(words, ()), (), words)
    job: TrainJob = config.job
    lock = load_split(job.split)
    assert lock.objects.test
    assert tuple(hand.name for hand in lock.hands.held_out) == job.exclude_hand
    assert config.components["distance"].record.name == method.distance
    if method.planner_weights:
        assert config.components["planner"].record.name == method.planner
        assert job.hand == method.hand
        assert job.out == f"runs/weights/{method.planner}-{method.hand}"
    else:
        assert config.components["generator"].record.name == generator
        assert job.exclude_hand == ((method.held_out,) if method.held_out else ())
        assert job.out == f"runs/weights/{generator}-{method.weights}"
    recipe = RECIPES[name]
    expected = HELD_OUT.get(name, recipe) if method.held_out else recipe
    assert set(expected) <= set(words)


def test_the_page_shows_the_recipes():
    page = (Path(__file__).resolve().parents[2] / "docs" / "training.md").read_text()
    rows = [line for line in page.splitlines() if line.startswith("| `")]
    names = [row.split("`")[1].partition("=")[2].split() for row in rows]
    lines = {name[0]: row for name, row in zip(names, rows, strict=True) if name}
    for name, words in RECIPES.items():
        assert f"`{' '.join(words)}`" in lines[name]
    for name, words in HELD_OUT.items():
        assert f"with a hand held out `{' '.join(set(words) - set(RECIPES[name]))}`" in lines[name]


def test_flow_is_trained_longer_where_a_hand_is_missing():
    unseen, full = ROWS["barrett, unseen"], ROWS["barrett, seen"]
    assert "epochs=7" in train_command(unseen, "flow")
    assert "epochs=6" in train_command(full, "flow")


def test_a_network_without_a_recipe_is_trained_with_its_defaults():
    command = train_command(ROWS["barrett, seen"], "mine")
    assert command == (
        "gdg train data=DATASET generator=mine distance=aligned split=paper "
        "out=runs/weights/mine-full"
    )
