"""Writes the bundled split locks: the paper's objects, with all hands or one held out.

    python tools/make_split_locks.py [--published FOLDER]

Run it whenever a bundled hand or object changes, and raise VERSION. Names and split of the 58
published objects, and the hashes of their meshes, come from FOLDER (``objects.json`` with ``file``
and ``split`` per name); without it they are kept as the locks have them. Bundled objects are
listed under their own names beside them.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from gdg.folders import HANDS, OBJECTS
from gdg.hands.hand import load_hand
from gdg.identity import body_hash, object_hash
from gdg.objects.spec import read_object_spec
from gdg.splits import (
    FOLDER,
    SUFFIX,
    HandSplit,
    LockedHand,
    LockedObject,
    ObjectSplit,
    SplitLock,
    bare_name,
    load_split,
    save_split,
)
from gdg.splits.make import choose_validation

VERSION = 1
NAME = "paper"
#: Share of the train objects that choose the best epoch, and the seed of that choice.
VALIDATION, SEED = 0.1, 0
SOURCE = (
    "48 train and 10 test objects of GenDexGrasp (Li et al., ICRA 2023), five of the train objects "
    "held back to choose the best epoch; and the bundled objects, by their manifests"
)
#: Lock of a hand -> the hands that it holds out; a mirror image is too much like the hand.
HELD_OUT = {
    "": (),
    "ezgripper": ("ezgripper",),
    "barrett": ("barrett",),
    "robotiq_3finger": ("robotiq_3finger",),
    "allegro": ("allegro", "allegro_right"),
    "shadowhand": ("shadowhand",),
}
Objects = dict[LockedObject, str]


def main() -> None:
    """Writes every lock."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--published", type=Path)
    given = parser.parse_args().published
    published = _published(given) if given else _kept()
    splits = published | _bundled()
    names = {bare_name(entry.name) for entry, split in published.items() if split == "train"}
    chosen = choose_validation(names, VALIDATION, SEED)
    for entry, split in splits.items():
        if split == "train" and bare_name(entry.name) in chosen:
            splits[entry] = "validation"
    objects = ObjectSplit(
        train=_of(splits, "train"),
        validation=_of(splits, "validation"),
        test=_of(splits, "test"),
    )
    hands = _hands()
    for without, held_out in HELD_OUT.items():
        name = f"{NAME}-without-{without}" if without else NAME
        lock = SplitLock(
            name=name,
            version=VERSION,
            source=SOURCE,
            objects=objects,
            hands=HandSplit(
                train=tuple(entry for key, entry in hands.items() if key not in held_out),
                held_out=tuple(entry for key, entry in hands.items() if key in held_out),
            ),
        )
        save_split(lock, FOLDER / f"{name}{SUFFIX}")


def _published(folder: Path) -> Objects:
    known = json.loads((folder / "objects.json").read_text(encoding="utf-8"))
    return {
        LockedObject(name=name, hash=object_hash(str((folder / facts["file"]).resolve()))): facts[
            "split"
        ]
        for name, facts in known.items()
    }


def _kept() -> Objects:
    objects = load_split(NAME).objects
    lists = (("train", objects.train), ("train", objects.validation), ("test", objects.test))
    return {entry: split for split, entries in lists for entry in entries if "+" in entry.name}


def _bundled() -> Objects:
    found = {}
    for folder in OBJECTS.all().values():
        if folder.tier == "bundled":
            spec = read_object_spec(folder.path)
            found[LockedObject(name=spec.name, hash=object_hash(str(folder.path)))] = spec.split
    return found


def _hands() -> dict[str, LockedHand]:
    loaded = [load_hand(folder.path) for folder in HANDS.all().values() if folder.tier == "bundled"]
    return {
        hand.name: LockedHand(name=hand.name, hash=hand.content_hash, body=body_hash(hand))
        for hand in sorted(loaded, key=lambda hand: hand.name)
    }


def _of(splits: Objects, which: str) -> tuple[LockedObject, ...]:
    chosen = (entry for entry, split in splits.items() if split == which)
    return tuple(sorted(chosen, key=lambda entry: (bare_name(entry.name), entry.name)))


if __name__ == "__main__":
    main()
