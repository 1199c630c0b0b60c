"""Tables hold every row, and say what is not known."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import pytest
from evaluation_fakes import LEFT_OUT
from PIL import Image

from gdg.evaluation.figure import Bar, draw_bars
from gdg.evaluation.run import run_eval
from gdg.evaluation.tables import BRIEF, UNKNOWN, cells, csv_text, header, markdown, number, span


def test_numbers_that_are_not_known_are_dashes():
    assert number(math.nan, 2) == UNKNOWN
    assert span((math.nan, math.nan)) == UNKNOWN
    assert span((-0.1, 1.2)) == "0–100"


def test_markdown_has_one_width_per_table_and_a_line_per_row(configs, tmp_path: Path):
    done = run_eval(configs("object=cube_small", "n=2", "planner.top=1,2"))
    text = (tmp_path / "out" / "summary.md").read_text()
    assert text == markdown(done.rows)
    for part in text.split("## ")[1:]:
        lines = [line for line in part.splitlines() if line.startswith("|")]
        assert len(lines) == 4
        assert len({line.count("|") for line in lines}) == 1
    assert len(cells(done.rows[0], BRIEF)) == len(done.rows[0].settings) + len(BRIEF)


def test_a_setting_that_is_a_column_stands_once_and_titles_fit_the_cells(configs, tmp_path: Path):
    done = run_eval(configs("object=cube_small", "n=1", "protocol=dro-2024,gendexgrasp-2022"))
    titles = header(done.rows, BRIEF)
    assert "protocol" in done.rows[0].settings
    assert titles.count("protocol") == 1
    for row, named in zip(done.rows, ("dro-2024-v1", "gendexgrasp-2022-v1"), strict=True):
        text = cells(row, BRIEF)
        assert len(text) == len(titles)
        assert text[titles.index("protocol")] == named


def test_what_a_simulator_leaves_out_is_said_once(configs, tmp_path: Path):
    done = run_eval(configs("object=cube_small", "n=2", "planner.top=1,2"))
    assert [row.left_out for row in done.rows] == [(LEFT_OUT,)] * 2
    assert (tmp_path / "out" / "summary.md").read_text().count(LEFT_OUT) == 1


def test_the_csv_has_every_number(configs, tmp_path: Path):
    run_eval(configs("object=cube_small", "n=2"))
    with (tmp_path / "out" / "summary.csv").open(newline="") as stream:
        (line,) = csv.DictReader(stream)
    assert line["success_n"] == "2"
    assert line["joints_pooled_rad"] == "" or float(line["joints_pooled_rad"]) >= 0
    for name in ("success_low", "macro", "first_share", "any_share", "penetration_mm_p95",
                 "epsilon", "seconds_simulate", "hardware"):  # fmt: skip
        assert name in line


def test_csv_lines_of_different_shapes_are_filled_up():
    assert csv_text([{"a": 1}, {"b": math.nan, "a": "x,y"}]) == 'a,b\n1,\n"x,y",\n'


@pytest.mark.parametrize("count", [1, 80])
def test_bars_are_drawn(tmp_path: Path, count: int):
    bars = [Bar(f"row {i}", 0.5, (0.4, 0.6), 0.7) for i in range(count)]
    draw_bars([*bars[:-1], Bar("missing", None, note="weights missing")], tmp_path / "a.png", "t")
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.width > 800
        assert len(picture.convert("RGB").getcolors(2**24) or ()) > 5
