"""The table of what was decided about a new hand can be read on a narrow terminal."""

from __future__ import annotations

import pytest

from gdg.cli.hands.decision_table import print_decisions
from gdg.hands.decisions import Decision

DECISIONS = (
    Decision("palm.normal", "[0, 0, 1]", 0.97, "balls rest on this side of it, " * 3),
    Decision("allowed_self_contacts", "0 pairs", 0.9, "they overlap in the open posture"),
    Decision("joint finger_1", "closes with larger values, 0 to 1.2", 0.4, "presses [red]it[/]"),
)


def printed(capsys: pytest.CaptureFixture[str], *decisions: Decision) -> str:
    print_decisions(decisions)
    return capsys.readouterr().out


def test_no_word_is_broken_on_a_terminal_of_80_columns(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("COLUMNS", "80")
    told = printed(capsys, *DECISIONS)
    for decision in DECISIONS:
        for word in f"{decision.subject} {decision.value} {decision.reason}".split():
            assert word in told.split()
    assert all(len(line) <= 80 for line in told.splitlines())


def test_a_long_joint_stays_whole_where_there_is_room(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("COLUMNS", "200")
    subject = "joint right_hand_thumb_proximal_yaw_joint"
    assert subject in printed(capsys, *DECISIONS, Decision(subject, "rests", 0.7, "does not press"))


def test_nothing_decided_is_an_empty_table(capsys: pytest.CaptureFixture[str]):
    assert "decided" in printed(capsys)
