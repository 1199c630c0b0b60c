"""Splits: lock files that say which objects and hands may be learned from. Light.

A lock names its objects and hands by name and by content hash, so that neither a renamed copy nor
another mesh of the same object slips from test into training. An object's name counts without its
dataset and scale: ``contactdb+apple``, ``apple@0.9`` and ``apple`` are one object to a lock.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, Field, model_validator

from gdg.cache import content_hash
from gdg.data.atomic import write_text_atomically
from gdg.errors import GdgError, did_you_mean
from gdg.validation import Plain, validated
from gdg.yaml_files import dump_yaml, read_yaml_mapping

FOLDER = Path(__file__).parent
SUFFIX = ".lock.yaml"
Hash = Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")]


class LockedObject(BaseModel, extra="forbid", frozen=True):
    """One object.

    Attributes:
        name: as in datasets, with or without its source's prefix.
        hash: content hash of its geometry; "" where only the name is known.
    """

    name: Plain
    hash: Hash = ""


class LockedHand(BaseModel, extra="forbid", frozen=True):
    """One hand.

    Attributes:
        name: the hand's name.
        hash: content hash of the hand folder; "" where only the name is known.
        body: hash of joints and shapes, which a renamed copy shares; "" where it is not known.
    """

    name: Plain
    hash: Hash = ""
    body: Hash = ""


class ObjectSplit(BaseModel, extra="forbid", frozen=True):
    """Objects to train on, to choose the best epoch by, and never to be seen in training."""

    train: tuple[LockedObject, ...] = ()
    validation: tuple[LockedObject, ...] = ()
    test: tuple[LockedObject, ...] = ()


class HandSplit(BaseModel, extra="forbid", frozen=True):
    """Hands to train on, and hands never to be seen in training."""

    train: tuple[LockedHand, ...] = ()
    held_out: tuple[LockedHand, ...] = ()


class SplitLock(BaseModel, extra="forbid", frozen=True):
    """A lock file.

    Attributes:
        format: of the file.
        name: of the split.
        version: raised whenever its content changes.
        source: where the split comes from, in a sentence.
        objects: disjoint lists of objects.
        hands: disjoint lists of hands.
    """

    format: Literal["gdg-split-1"] = "gdg-split-1"
    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9._-]*$")]
    version: Annotated[int, Field(ge=1)] = 1
    source: Plain = ""
    objects: ObjectSplit
    hands: HandSplit

    @model_validator(mode="after")
    def _is_disjoint(self) -> SplitLock:
        objects = {
            where: {key for entry in getattr(self.objects, where) for key in _keys_of_object(entry)}
            for where in ObjectSplit.model_fields
        }
        hands = {
            where: {key for entry in getattr(self.hands, where) for key in _keys_of_hand(entry)}
            for where in HandSplit.model_fields
        }
        mistakes = [*_shared("objects", objects), *_shared("hands", hands)]
        if mistakes:
            raise ValueError("; ".join(mistakes))
        return self

    @property
    def label(self) -> str:
        """``name-vVERSION``, as it is written into run records."""
        return f"{self.name}-v{self.version}"

    @property
    def content_hash(self) -> str:
        """Of all that the lock says, however the file is laid out; 64 hex digits."""
        return content_hash(self.model_dump_json())


def bare_name(object_name: str) -> str:
    """An object's name without dataset and scale: ``apple`` of ``contactdb+apple@0.9``."""
    own = object_name.rpartition("+")[2]
    return own.partition("@")[0] or own


def where_is_object(lock: SplitLock, name: str, content: str) -> str:
    """``train``, ``validation``, ``test`` or "": where a lock has an object.

    A match in ``test``, by name or by content, counts before any other, then one in
    ``validation``.
    """
    for where in ("test", "validation", "train"):
        entries: Sequence[LockedObject] = getattr(lock.objects, where)
        if any(
            bare_name(e.name) == bare_name(name) or (content and e.hash == content) for e in entries
        ):
            return where
    return ""


def held_out_hand(lock: SplitLock, name: str, content: str, body: str = "") -> LockedHand | None:
    """The held-out hand that a name, a content hash or a body hash means, or None."""
    for entry in lock.hands.held_out:
        same = (content and entry.hash == content) or (body and entry.body == body)
        if same or entry.name == name:
            return entry
    return None


def split_names() -> list[str]:
    """Names of the bundled locks."""
    return sorted(path.name.removesuffix(SUFFIX) for path in FOLDER.glob(f"*{SUFFIX}"))


def load_split(given: str) -> SplitLock:
    """A bundled lock by name, or the one in a file by path.

    Raises:
        GdgError: unknown name (with a suggestion), unreadable file, or a broken schema.
    """
    path = FOLDER / f"{given}{SUFFIX}"
    if given not in split_names():
        path = Path(os.path.expanduser(given))
        if path.suffix not in (".yaml", ".yml"):
            raise GdgError(
                f"Unknown split '{given}'.{did_you_mean(given, split_names())} A lock file is "
                f"given by its path, e.g. ./{given}{SUFFIX}."
            )
    return validated(SplitLock, read_yaml_mapping(path), str(path))


def save_split(lock: SplitLock, path: Path) -> None:
    """Writes a lock file, atomically."""
    tree = lock.model_dump(mode="json")
    for section in (tree["objects"], tree["hands"]):
        for where, entries in section.items():
            section[where] = [{k: v for k, v in entry.items() if v} for entry in entries]
    write_text_atomically(path, dump_yaml(tree))


def _keys_of_object(entry: LockedObject) -> Iterator[str]:
    yield f"'{bare_name(entry.name)}'"
    if entry.hash:
        yield f"the content {entry.hash[:12]}…"


def _keys_of_hand(entry: LockedHand) -> Iterator[str]:
    yield f"'{entry.name}'"
    if entry.hash:
        yield f"the content {entry.hash[:12]}…"
    if entry.body:
        yield f"the body {entry.body[:12]}…"


def _shared(what: str, lists: dict[str, set[str]]) -> Iterator[str]:
    names = list(lists)
    for index, first in enumerate(names):
        for second in names[index + 1 :]:
            for key in sorted(lists[first] & lists[second]):
                yield f"{what}: {key} stands in both {first} and {second}"
