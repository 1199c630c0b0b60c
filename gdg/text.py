"""Foreign text made fit for one line of a terminal or of another file. Light."""

from __future__ import annotations


def one_line(text: str) -> str:
    """Text without line breaks and other control characters, and with single spaces."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())
