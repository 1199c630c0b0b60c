"""The one error type that users see, and the suggestions that go with it."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class GdgError(Exception):
    """A mistake in what the user gave: what was given, why it is wrong, what to write instead.

    The command line prints its message as one sentence and exits with code 2.
    """


class MissingWeights(GdgError):
    """A component has no weights for what is asked of it; the message says how to get some."""


class GdgErrors(GdgError):
    """Several mistakes found in one pass, so that the user can mend them all at once.

    Attributes:
        messages: one sentence per mistake, in the order in which they were found.
    """

    def __init__(self, messages: Iterable[str]):
        self.messages = tuple(messages)
        super().__init__("\n".join(self.messages))


def did_you_mean(given: str, known: Iterable[str]) -> str:
    """Gives ` Did you mean 'x'?` for the nearest known name, or the list of known names.

    The text starts with a space, so that it can be appended to a sentence; it is empty when
    nothing is known.
    """
    names = sorted(set(known))
    nearest = difflib.get_close_matches(given, names, n=1, cutoff=0.6)
    if nearest:
        return f" Did you mean '{nearest[0]}'?"
    if not names:
        return ""
    shown = ", ".join(names[:12]) + (", …" if len(names) > 12 else "")
    return f" Known: {shown}."


def raise_if_any(messages: list[str]) -> None:
    """Raises one ``GdgErrors`` with all messages, or returns when there are none."""
    if messages:
        raise GdgErrors(messages)
