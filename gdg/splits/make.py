"""Makes the lock of a dataset."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

import numpy as np

from gdg.data.shards import ShardInfo
from gdg.errors import GdgError, did_you_mean, raise_if_any
from gdg.folders import HANDS
from gdg.identity import Assets, body_hash
from gdg.splits import HandSplit, LockedHand, LockedObject, ObjectSplit, SplitLock, bare_name
from gdg.splits.catalogue import catalogue_tests
from gdg.validation import validated

TEST = "test"


def make_split(
    found: Sequence[ShardInfo],
    name: str,
    *,
    held_out: Collection[str] = (),
    validation: float = 0.1,
    seed: int = 0,
    assets: Assets | None = None,
) -> SplitLock:
    """The lock that divides the objects and hands of a dataset; the same for the same input.

    Test objects are those that the dataset or the catalogue of objects that gdg finds says are;
    those of the catalogue are listed even where the dataset lacks them.

    Args:
        found: the dataset's shards.
        name: of the split.
        held_out: names of the hands to hold out.
        validation: share of the train objects that choose the best epoch; all meshes of one
            object count as one and stay together.
        seed: of that choice.
        assets: where hands and objects are looked up.

    Raises:
        GdgErrors: hands that nobody knows or that go by two names, or too few objects or hands to
            train on.
    """
    assets = assets or Assets()
    in_data = {info.hand for info in found}
    known = in_data | set(HANDS.all())
    mistakes = [
        f"held-out hand '{hand}': there is no such hand.{did_you_mean(hand, known)}"
        for hand in held_out
        if hand not in known
    ]
    if in_data and not in_data - set(held_out):
        mistakes.append("every hand of the dataset is held out; none is left to train on.")
    raise_if_any(mistakes)
    hands = _hands(found, held_out, assets)
    tests = {LockedObject(name=name, hash=key) for name, key in catalogue_tests().items()}
    entries = {LockedObject(name=info.object_name, hash=info.object_hash) for info in found}
    kinds = _kinds(entries | tests)
    said = {LockedObject(name=i.object_name, hash=i.object_hash) for i in found if i.split == TEST}
    test_kinds = {kinds[entry] for entry in tests | said}
    rest = {kinds[entry] for entry in entries} - test_kinds
    chosen = choose_validation(rest, validation, seed)
    parts = {
        "train": _sorted(e for e in entries if kinds[e] in rest - chosen),
        "validation": _sorted(e for e in entries if kinds[e] in chosen),
        "test": _sorted(e for e in entries | tests if kinds[e] in test_kinds),
    }
    tree = {
        "name": name,
        "source": f"made from a dataset with validation {validation:g} and seed {seed}",
        "objects": ObjectSplit(**parts),
        "hands": hands,
    }
    return validated(SplitLock, tree, "split")


def _kinds(entries: Collection[LockedObject]) -> dict[LockedObject, str]:
    """Entry -> the first bare name of its kind: those of one bare name or content are of one."""
    kinds = {entry: bare_name(entry.name) for entry in entries}
    changed = True
    while changed:
        first: dict[str, str] = {}
        for entry, kind in kinds.items():
            for key in _keys(entry):
                first[key] = min(kind, first.get(key, kind))
        nearest = {entry: min(first[key] for key in _keys(entry)) for entry in entries}
        changed, kinds = nearest != kinds, nearest
    return kinds


def _keys(entry: LockedObject) -> list[str]:
    return [f"name {bare_name(entry.name)}", *([f"hash {entry.hash}"] if entry.hash else [])]


def choose_validation(names: Iterable[str], share: float, seed: int) -> set[str]:
    """Some of the names, at least one; none where the share is 0.

    Raises:
        GdgError: none would be left to train on.
    """
    ordered = sorted(set(names))
    if share == 0:
        return set()
    count = max(1, round(share * len(ordered)))
    if count >= len(ordered):
        raise GdgError(
            f"validation: {share:g} of {len(ordered)} object(s) leaves none to train on; give data "
            f"of more objects, or 0."
        )
    order = np.random.default_rng(seed).permutation(len(ordered))
    return {ordered[index] for index in order[:count]}


def _hands(found: Sequence[ShardInfo], held_out: Collection[str], assets: Assets) -> HandSplit:
    out = {_locked(info, assets) for info in found if info.hand in held_out}
    for name in held_out:
        hand = assets.hand(name)
        if hand is not None:
            out.add(LockedHand(name=name, hash=hand.content_hash, body=body_hash(hand)))
        elif name not in {entry.name for entry in out}:
            out.add(LockedHand(name=name))
    train = {_locked(info, assets) for info in found if info.hand not in held_out}
    raise_if_any(
        sorted(
            f"hand '{hand.name}' is the held-out hand '{other.name}' under another name; hold it "
            f"out, too."
            for hand in train
            for other in out
            if (hand.hash and hand.hash == other.hash) or (hand.body and hand.body == other.body)
        )
    )
    return HandSplit(train=_sorted(train), held_out=_sorted(out))


def _locked(info: ShardInfo, assets: Assets) -> LockedHand:
    hand = assets.hand_of(info)
    same = hand is not None and hand.content_hash == info.hand_hash
    body = body_hash(hand) if hand is not None and same else ""
    return LockedHand(name=info.hand, hash=info.hand_hash, body=body)


def _sorted(entries: Iterable) -> tuple:
    return tuple(sorted(entries, key=lambda entry: (entry.name, entry.hash)))
