"""Where a description comes from and on what terms, as far as its files say."""

from __future__ import annotations

import os
import re
from pathlib import Path

from gdg.text import one_line

#: So many folders above the description may hold its licence.
LICENCE_PARENTS = 3
LICENCE_NAMES = ("license", "licence", "copying")
MAX_LICENCE_BYTES = 200_000
#: Phrases, in lower case with single spaces, by which a licence's text is known.
PHRASES = (
    ("Apache-2.0", ("apache license", "version 2.0")),
    ("MPL-2.0", ("mozilla public license", "version 2.0")),
    ("AGPL-3.0", ("gnu affero general public license", "version 3")),
    ("LGPL-3.0", ("gnu lesser general public license", "version 3")),
    ("LGPL-2.1", ("gnu lesser general public license", "version 2.1")),
    ("GPL-3.0", ("gnu general public license", "version 3")),
    ("GPL-2.0", ("gnu general public license", "version 2")),
    ("BSD-3-Clause", ("redistribution and use in source and binary forms", "neither the name")),
    ("BSD-2-Clause", ("redistribution and use in source and binary forms",)),
    ("MIT", ("permission is hereby granted, free of charge", "the above copyright notice and")),
    ("CC0-1.0", ("cc0 1.0",)),
    ("CC-BY-NC-SA-4.0", ("attribution-noncommercial-sharealike 4.0",)),
    ("CC-BY-NC-4.0", ("attribution-noncommercial 4.0",)),
    ("CC-BY-SA-4.0", ("attribution-sharealike 4.0",)),
    ("CC-BY-4.0", ("attribution 4.0 international",)),
)
COMMENT = re.compile(r"<!--(.*?)-->", re.DOTALL)
TELLING = re.compile(r"licen[sc]e|copyright|©|\bauthors?\b|\(c\)", re.IGNORECASE)
#: Lines drawn in comments.
RULE = re.compile(r"[=*#_~-]{3,}")
MAX_COMMENT = 300


def stated_source(path: Path, kind: str, robot: str) -> str:
    """``URDF file 'hand.urdf', robot 'hand'``, and the file's comment on authors or licence."""
    stated = f"{kind} file '{one_line(path.name)}'"
    if robot:
        stated += f", robot '{_without_rules(robot)[:80]}'"
    for comment in COMMENT.findall(path.read_text(encoding="utf-8", errors="replace")):
        if TELLING.search(comment):
            return f"{stated}; its comment: {_without_rules(comment)[:MAX_COMMENT]}"
    return stated


def find_licence(path: Path) -> str | None:
    """The licence in a file beside or above a description: ``MIT (LICENSE)``, or its first words.

    The search ends at the first folder that has one, is a git repository, or is the home folder.
    """
    folder = path.absolute().parent
    for parent in (folder, *folder.parents[:LICENCE_PARENTS]):
        if parent in (Path.home(), Path(parent.anchor)):
            return None
        try:
            names = sorted(os.listdir(parent))
        except OSError:  # a folder that may be passed through but not listed
            return None
        for name in names:
            if name.lower().startswith(LICENCE_NAMES) and os.path.isfile(parent / name):
                return _licence_in(parent / name)
        if (parent / ".git").exists():
            return None
    return None


def _licence_in(file: Path) -> str | None:
    try:
        with file.open("rb") as stream:
            data = stream.read(MAX_LICENCE_BYTES)
    except OSError:
        return None
    text = _without_rules(data.decode("utf-8", errors="replace"))
    file_name = one_line(file.name)
    for name, phrases in PHRASES:
        if all(phrase in text.lower() for phrase in phrases):
            return f"{name} ({file_name})"
    return f"{file_name}: {text[:MAX_COMMENT]}" if text else None


def _without_rules(text: str) -> str:
    return " ".join(word for word in one_line(text).split() if not RULE.fullmatch(word))
