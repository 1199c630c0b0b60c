"""Refuses grasps that a training run must not see: of test objects and of held-out hands.

Objects are known by the split that their shard records, by their name whatever dataset it is
prefixed with, and by their content; hands by name, by content, and by body, which a renamed copy
shares.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from gdg.data.shards import ShardInfo
from gdg.errors import raise_if_any
from gdg.identity import Assets, body_hash
from gdg.splits import SplitLock, held_out_hand, where_is_object
from gdg.splits.catalogue import is_test_object

TEST = "test"


def refuse_test_objects(found: Sequence[ShardInfo]) -> None:
    """Raises if any shard's object is a test object by its record, by name or by content.

    Raises:
        GdgError: naming each such object and one of its shards.
    """
    objects = {(i.object_name, i.object_hash, i.split): i for i in reversed(found)}
    leaks = {
        info.object_name: info.path
        for (name, content, split), info in objects.items()
        if split == TEST or is_test_object(name, content)
    }
    raise_if_any(
        [
            f"data: {path}: '{name}' is a test object, and training on it would spoil every test "
            f"on it; remove its folder from the data."
            for name, path in sorted(leaks.items())
        ]
    )


def refuse_renamed_hands(
    chosen: Sequence[ShardInfo], excluded: Sequence[ShardInfo], names: Sequence[str], assets: Assets
) -> None:
    """Raises if a chosen hand is an excluded one under another name.

    Args:
        chosen: shards of the hands that may be learned from.
        excluded: shards of those that may not.
        names: of the excluded hands.
        assets: where hands are looked up.

    Raises:
        GdgError: naming each such hand and one of its shards.
    """
    if not names:
        return
    hands = {name: assets.hand(name) for name in names}
    contents = {info.hand_hash: info.hand for info in excluded}
    contents |= {hand.content_hash: name for name, hand in hands.items() if hand is not None}
    bodies = {body_hash(hand): name for name, hand in hands.items() if hand is not None}
    bodies |= {_body(info, assets): info.hand for info in _first_of_each_hand(excluded)}
    bodies.pop("", None)
    mistakes = []
    for info in _first_of_each_hand(chosen):
        name = contents.get(info.hand_hash) or bodies.get(_body(info, assets))
        if name:
            mistakes.append(
                f"data: {info.path}: '{info.hand}' is the excluded hand '{name}' under another "
                f"name; exclude '{info.hand}', too."
            )
    raise_if_any(mistakes)


def refuse_renamed_objects(chosen: Sequence[ShardInfo], excluded: Sequence[ShardInfo]) -> None:
    """Raises if a chosen object is an excluded one under another name, by its content.

    Raises:
        GdgError: naming each such object and one of its shards.
    """
    contents = {info.object_hash: info.object_name for info in excluded}
    mistakes = {
        info.object_name: f"data: {info.path}: '{info.object_name}' is the excluded object "
        f"'{contents[info.object_hash]}' under another name; exclude '{info.object_name}', too."
        for info in reversed(chosen)
        if info.object_hash in contents
    }
    raise_if_any([mistakes[name] for name in sorted(mistakes)])


def refuse_by_lock(chosen: Sequence[ShardInfo], lock: SplitLock, assets: Assets) -> None:
    """Raises if any shard is not what a lock lets a run learn from.

    Raises:
        GdgError: naming each test object, held-out hand and unlisted object or hand, and one of
            its shards.
    """
    objects = {(info.object_name, info.object_hash): info for info in reversed(chosen)}
    mistakes = [
        *(text for info in objects.values() for text in _object_mistake(info, lock)),
        *(
            text
            for info in _first_of_each_hand(chosen)
            for text in _hand_mistake(info, lock, assets)
        ),
    ]
    raise_if_any(sorted(mistakes))


def _object_mistake(info: ShardInfo, lock: SplitLock) -> Iterator[str]:
    where, start = _where(info, lock), f"data: {info.path}: '{info.object_name}'"
    if where == TEST:
        yield f"{start} is a test object of the split {lock.label}; remove its folder."
    elif not where:
        yield (
            f"{start} is not in the split {lock.label}, which can't tell whether it may be learned "
            f"from; write a lock that has it: gdg data split."
        )


def _where(info: ShardInfo, lock: SplitLock) -> str:
    return where_is_object(lock, info.object_name, info.object_hash)


def _hand_mistake(info: ShardInfo, lock: SplitLock, assets: Assets) -> Iterator[str]:
    body = _body(info, assets) if any(entry.body for entry in lock.hands.held_out) else ""
    held_out = held_out_hand(lock, info.hand, info.hand_hash, body)
    start = f"data: {info.path}: '{info.hand}'"
    if held_out is not None:
        renamed = f" '{held_out.name}' under another name" if held_out.name != info.hand else ""
        yield (
            f"{start} is the held-out hand{renamed} of the split {lock.label}; write "
            f"exclude_hand={info.hand} to leave its grasps aside."
        )
    elif not any(
        entry.name == info.hand or entry.hash == info.hand_hash for entry in lock.hands.train
    ):
        yield (
            f"{start} is a hand that is not in the split {lock.label}; write a lock that has it: "
            f"gdg data split, or exclude_hand={info.hand}."
        )


def _first_of_each_hand(found: Sequence[ShardInfo]) -> list[ShardInfo]:
    """One shard of each hand, where name, content or path tell hands apart."""
    first = {(i.hand, i.hand_hash, i.hand_path): i for i in reversed(found)}
    return list(first.values())


def _body(info: ShardInfo, assets: Assets) -> str:
    hand = assets.hand_of(info)
    return body_hash(hand) if hand is not None else ""
