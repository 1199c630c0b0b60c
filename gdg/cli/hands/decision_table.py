"""What was decided about a new hand, as a table for terminals."""

from __future__ import annotations

from collections.abc import Iterable

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table
from rich.text import Text

from gdg.hands.decisions import Decision

HEADS = ("decided", "value", "how sure", "why")
#: The first column is as wide as its longest name, but at most this share of the terminal; and may
#: take this many letters of a narrow one, the longest field of a manifest.
SUBJECT_SHARE, SUBJECT_WIDTH = 0.25, len("allowed_self_contacts")


def print_decisions(decisions: Iterable[Decision]) -> None:
    """One row per decision: what was decided, how sure that is, and why."""
    console, listed = Console(), list(decisions)
    # Text, not str: rich would read [brackets] in names as markup
    subjects = [Text(decision.subject) for decision in listed]
    widest = max(text.cell_len for text in (Text(HEADS[0]), *subjects))
    width = min(widest, max(SUBJECT_WIDTH, int(SUBJECT_SHARE * console.width)))
    table = Table(box=SIMPLE, pad_edge=False, header_style="bold")
    # a fixed width: rich would narrow all columns alike, and break words
    table.add_column(HEADS[0], overflow="fold", width=width)
    for head in HEADS[1:]:
        table.add_column(head, overflow="fold")
    for subject, decision in zip(subjects, listed, strict=True):
        sure = f"{decision.verdict} ({decision.confidence:.0%})"
        table.add_row(subject, Text(decision.value), Text(sure), Text(decision.reason))
    console.print(table)
