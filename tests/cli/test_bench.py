"""``gdg bench`` on the command line."""

from __future__ import annotations

import pytest
from command_line import refused


def test_unknown_tables_and_settings_are_told(run):
    refused(run("bench", "tabel1"), "Unknown table 'tabel1'", "Did you mean 'table1'?")
    refused(run("bench", "table1", "fiter=adam"), "Did you mean 'fitter'?")
    refused(run("bench", "table1", "hand=allegro"), "hand: is set by the table")
    refused(run("bench"), "TABLE")


def test_help_lists_the_tables(run):
    out = run("bench", "--help").out
    for name in ("table1", "table2", "table3", "--quick", "weights"):
        assert name in out


@pytest.mark.timeout(600)
def test_a_quick_table_runs_with_real_components(run, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("GDG_TEST_ASSETS", raising=False)
    words = ("table1", "--quick", "n=1", "object=baseball", "out=here", "workers=1",
             "simulator.trials=decisive", "hand_model.surface_points=300")  # fmt: skip
    outcome = run("bench", *words)
    assert outcome.code == 0, outcome.err
    for part in ("DFC", "GenDexGrasp", "79.5", "the bundled hand", "here/table1.md", "QUICK"):
        assert part in outcome.out
    again = run("bench", *words)
    assert again.out == outcome.out
