"""Pages of the documentation with tables that a script writes."""

from __future__ import annotations

from pathlib import Path

#: Between lines that begin like the first, and say how, and the second stand the tables.
BEGIN, END = "<!-- tables: begin", "<!-- tables: end -->"


def write_tables(page: Path, text: str) -> None:
    """Puts tables in place of those between the page's marks."""
    whole = page.read_text(encoding="utf-8")
    head, begin, rest = whole.partition(BEGIN)
    mark, newline, body = rest.partition("\n")
    _, end, tail = body.partition(END)
    if not begin or not end:
        raise SystemExit(f"{page}: lacks a line '{BEGIN} … -->' or the line '{END}'")
    page.write_text(f"{head}{begin}{mark}{newline}\n{text}\n\n{end}{tail}", encoding="utf-8")
