"""The bundled sample of the dataset, the page about it, and the script that sums datasets up."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from types import ModuleType

import pytest
from click.testing import CliRunner

from gdg.cli.data import data
from gdg.data.columns import TYPES
from gdg.data.dataset import stream_grasps
from gdg.pipeline.jobs import SynthJob
from gdg.quality import METRICS
from gdg.registry import get_registry

ROOT = Path(__file__).resolve().parents[1]
SAMPLE, PAGE = ROOT / "docs" / "examples" / "dataset", ROOT / "docs" / "dataset.md"
MOST_BYTES = 5_000_000


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """docs/figures/dataset.py."""
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "figures"))
    return importlib.import_module("dataset")


def test_the_sample_is_small_and_has_two_hands_on_three_objects_each():
    assert sum(path.stat().st_size for path in SAMPLE.rglob("*") if path.is_file()) < MOST_BYTES
    pairs = {(grasps.hand, grasps.object_name) for grasps in stream_grasps(SAMPLE)}
    hands, objects = {hand for hand, _ in pairs}, {name for _, name in pairs}
    assert (len(hands), len(objects), len(pairs)) == (2, 3, 6)


def test_every_grasp_of_the_sample_passed_and_is_measured_and_within_the_limits():
    for grasps in stream_grasps(SAMPLE):
        assert len(grasps.passed) == len(grasps) > 0
        assert set(METRICS) <= set(grasps.metrics)
        assert grasps.contacts is not None
        assert len(grasps.contacts) == len(grasps)
        assert grasps.metrics["penetration_mm"].max() <= 1.0
        assert grasps.metrics["self_penetration_mm"].max() <= 1.0
        assert {verdict.protocol for verdict in grasps.verdicts} == {"dro-2024-v1"}


def test_validate_finds_no_mistake_in_the_sample():
    outcome = CliRunner().invoke(data, ["validate", str(SAMPLE)])
    assert outcome.exit_code == 0, outcome.output
    assert "error" not in outcome.output


@pytest.mark.parametrize("number", [0, 1])
def test_the_pages_python_reads_the_sample(
    number: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text("utf-8"), re.M | re.S)
    assert len(blocks) == 2
    monkeypatch.chdir(ROOT)
    exec(compile(blocks[number], f"{PAGE.name}, block {number}", "exec"), {})
    assert "index_abduction" in capsys.readouterr().out


def test_the_page_tells_every_column():
    page = PAGE.read_text(encoding="utf-8")
    for name in (*TYPES, *(f"metric_{metric}" for metric in METRICS)):
        assert f"`{name}`" in page, name


def test_the_options_that_the_page_names_exist_with_these_defaults():
    page = PAGE.read_text(encoding="utf-8")
    table = page.partition("| option | default |")[2].partition("\n\n")[0]
    rows = re.findall(r"^\| (`.*?) \| (.*?) \|", table, re.M)
    assert len(rows) > 8
    for names, defaults in rows:
        given = re.findall(r"`([\w.]+)`", names)
        for name, default in zip(given, defaults.split(", "), strict=False):
            assert default.startswith(_default(name)), name


def _default(name: str) -> str:
    kind, dot, option = name.partition(".")
    if not dot:
        value = SynthJob.model_fields[name].default
    else:
        component = {"planner": "dfc", "simulator": "sapien"}[kind]
        value = get_registry().find(kind, component).options.model_fields[option].default
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


def test_the_pages_links_lead_somewhere_and_the_readme_leads_here():
    for target in re.findall(r"\]\(([^)#\s]+)\)", PAGE.read_text(encoding="utf-8")):
        assert target.startswith("http") or (PAGE.parent / target).exists(), target
    assert "docs/dataset.md" in (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_tables_count_what_the_sample_holds(script: ModuleType):
    pairs = script.read_pairs(SAMPLE)
    count = sum(map(len, stream_grasps(SAMPLE)))
    text = script.tables(pairs)
    assert f"{count} passing grasps of 2 hands on 3 objects (6 pairs)" in script.summary(
        SAMPLE, pairs
    )
    (row,) = [line for line in text.splitlines() if line.startswith("| all | 6 ")]
    assert row.startswith(f"| all | 6 | 0 | 6 | 0 | {count} |")
    assert "| nan" not in text


def test_tables_replace_what_stands_between_the_marks_and_nothing_else(
    script: ModuleType, tmp_path: Path
):
    page = tmp_path / "page.md"
    before = "before\n<!-- tables: begin (how) -->\n\nold\n\n<!-- tables: end -->\nafter\n"
    page.write_text(before)
    for _ in range(2):
        script.write_tables(page, "new")
        assert page.read_text() == before.replace("old", "new")
    page.write_text("no marks")
    with pytest.raises(SystemExit, match="lacks a line"):
        script.write_tables(page, "new")
