"""Rebuilds a full dataset from a compact file: measures every grasp anew, or simulates it too."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch

from gdg.cache import content_hash
from gdg.data.dataset import shard_path, write_shard
from gdg.data.grasps import GraspSet
from gdg.data.layouts.compact import Group, read_compact
from gdg.data.layouts.lookup import Lookup
from gdg.data.scene import TableScene
from gdg.data.shards import ShardInfo, read_info
from gdg.errors import GdgError, GdgErrors
from gdg.kinds.hand_model import HandModel
from gdg.kinds.simulator import Simulator
from gdg.objects.model import ObjectModel
from gdg.pipeline.jobs import DEFAULTS
from gdg.pipeline.workers import run_all
from gdg.protocols import Protocol, load_protocol
from gdg.registry import get_registry
from gdg.scenes.place import on_table_again
from gdg.splits.catalogue import TEST, is_test_object
from gdg.starts import prepare, simulated

#: Provenance of a shard: whether its grasps were simulated when it was rebuilt.
SIMULATED = "simulated"


@dataclass(frozen=True)
class RebuildTask:
    """One group of grasps to rebuild, in whatever process.

    Attributes:
        file: the compact file.
        group: which of its grasps.
        rows: where these stand in the file.
        lookup: finds hand and object.
        out: the dataset's folder.
        simulate: test the grasps again under the protocol that they passed.
        accept_changed: use a hand or object whose content is no longer what it was.
    """

    file: Path
    group: Group
    rows: tuple[int, ...]
    lookup: Lookup
    out: Path
    simulate: bool = False
    accept_changed: bool = False


@dataclass(frozen=True)
class RebuildResult:
    """What became of a group.

    Attributes:
        hand: its name.
        object_name: its name.
        count: grasps in the dataset.
        passed: those whose verdict is success.
        reason: why the group was left out, or "".
        notes: what the user should know.
        found: whether the shard stood there already.
    """

    hand: str
    object_name: str
    count: int = 0
    passed: int = 0
    reason: str = ""
    notes: tuple[str, ...] = ()
    found: bool = False


def rebuild_dataset(
    file: Path,
    out: Path,
    lookup: Lookup,
    simulate: bool = False,
    accept_changed: bool = False,
    workers: int = 1,
    report: Callable[[int, int, RebuildResult], None] | None = None,
) -> list[RebuildResult]:
    """Rebuilds every group of a compact file; a group that stands there already is left alone.

    One that stands there without having been simulated is replaced where ``simulate`` is asked for.

    Args:
        file: the compact file.
        out: the dataset's folder.
        lookup: finds hands and objects.
        simulate: test the grasps again.
        accept_changed: see ``RebuildTask``.
        workers: processes.
        report: called with (groups done, groups in all, the last one's result).

    Raises:
        GdgError: the file can't be read.
    """
    groups = read_compact(file).groups()
    tasks = [
        RebuildTask(file, group, tuple(rows.tolist()), lookup, out, simulate, accept_changed)
        # one object after the other, since each is loaded once
        for group, rows in sorted(groups.items(), key=lambda g: (g[0].object_name, g[0].hand))
    ]
    _loaded.cache_clear()  # files may have changed since the last call
    results = []
    for _, result in run_all(rebuild_group, tasks, workers):
        results.append(result)
        if report is not None:
            report(len(results), len(tasks), result)
    return results


class _Loaded:
    """A compact file with the hands and the object that its grasps need, each loaded once."""

    def __init__(self, file: Path, lookup: Lookup):
        self.stored = read_compact(file)
        self.lookup = lookup
        self._models: dict[str, HandModel] = {}

    def model(self, name: str) -> HandModel:
        """The tensors of a hand."""
        hand = self.lookup.hand(name)
        if name not in self._models:
            record = get_registry().find("hand-model", DEFAULTS["hand_model"])
            self._models[name] = record.load()(record.options(), hand, torch.device("cpu"))
        return self._models[name]


@lru_cache(maxsize=1)
def _loaded(file: Path, words: Any) -> _Loaded:
    """What this process has loaded; the same call gives the same object."""
    return _Loaded(file, Lookup.of_words(words))


def rebuild_group(task: RebuildTask) -> RebuildResult:
    """Measures (and simulates) the grasps of one group, and writes their shard."""
    try:
        return _rebuild(task)
    except GdgError as error:
        return RebuildResult(task.group.hand, task.group.object_name, reason=str(error))


def _rebuild(task: RebuildTask) -> RebuildResult:
    loaded, group = _loaded(task.file, task.lookup.words()), task.group
    grasps = loaded.stored.grasps(group, np.array(task.rows))
    hand, obj, changed = _load(task, loaded, grasps.scene)
    grasps = replace(grasps, scene=obj.scene)
    key = content_hash(
        "rebuild-2", grasps.poses.numpy().tobytes(), grasps.joints.numpy().tobytes(),
        hand.hand.content_hash, obj.content_hash, group.protocol, int(group.refined),
        *filter(None, [group.scene]),
    )[:16]  # fmt: skip
    there = _there(shard_path(task.out, group.hand, group.object_name, key))
    if there is not None and (there.provenance.get(SIMULATED) or not task.simulate):
        return RebuildResult(
            group.hand, group.object_name, there.count, there.passed or 0, found=True
        )
    notes = list(changed)
    protocol = _protocol(task, notes)
    if changed:
        grasps = replace(grasps, verdicts=())
    if protocol is not None and task.simulate:
        grasps = simulated(_simulator(), hand, obj, grasps, protocol, group.refined)
    elif protocol is not None:
        prepared = prepare(hand, obj, grasps, protocol, group.refined)
        grasps = replace(grasps, targets=prepared.targets)
    grasps = _measured(hand, obj, grasps)
    facts = loaded.stored.objects[group.object_name]
    is_test = TEST in (obj.split, facts.split) or is_test_object(
        group.object_name, obj.content_hash
    )
    write_shard(
        task.out,
        key,
        grasps,
        {
            "hand_hash": hand.hand.content_hash,
            "object_hash": obj.content_hash,
            "split": TEST if is_test else obj.split or facts.split,
            "hand_path": loaded.lookup.hand_place(group.hand),
            "object_path": loaded.lookup.object_place(group.object_name),
            "object_scale": facts.scale,
            "rebuilt_from": task.file.name,
            SIMULATED: task.simulate,
        },
    )
    passed = len(grasps.passed)
    return RebuildResult(group.hand, group.object_name, len(grasps), passed, notes=tuple(notes))


def _there(path: Path) -> ShardInfo | None:
    """The shard that an earlier run wrote; None where there is none that can be read."""
    try:
        return read_info(path) if path.is_file() else None
    except GdgError:
        return None


def _load(
    task: RebuildTask, loaded: _Loaded, scene: TableScene | None
) -> tuple[HandModel, ObjectModel, list[str]]:
    """Hand and object in its scene, and how they differ from those the grasps were made with.

    An object that has changed is put on its table anew.
    """
    group, stored = task.group, loaded.stored
    hand = loaded.lookup.hand(group.hand)
    facts = stored.hands[group.hand]
    if hand.spec.joints != facts.joint_names or hand.spec.root_link != facts.root_link:
        raise GdgError(
            f"hand '{group.hand}': {hand.folder} has other joints or another root link than the "
            f"hand of {task.file}; give that one: --hand {group.hand}=FOLDER."
        )
    object_facts = stored.objects[group.object_name]
    obj = loaded.lookup.object(group.object_name, scale=object_facts.scale)
    pairs = (
        ("hand", group.hand, hand.folder, hand.content_hash, facts.content_hash),
        ("object", group.object_name, obj.path, obj.content_hash, object_facts.content_hash),
    )
    changed = [
        f"{what} '{name}': {path} is another version than the grasps of {task.file} were made with"
        for what, name, path, now, then in pairs
        if now != then
    ]
    if changed and not task.accept_changed:
        raise GdgErrors(
            f"{text}; give that one (--hand NAME=FOLDER, --object NAME=FILE), or write "
            f"--accept-changed to measure the grasps with this one."
            for text in changed
        )
    notes = [f"{text}; stored verdicts were dropped." for text in changed]
    if scene is not None and obj.content_hash != object_facts.content_hash:
        obj = on_table_again(obj, scene)
    else:
        obj = replace(obj, scene=scene)
    return loaded.model(group.hand), obj, notes


def _protocol(task: RebuildTask, notes: list[str]) -> Protocol | None:
    """The protocol that the grasps were tested under, if gdg still has that version."""
    name, _, version = task.group.protocol.rpartition("-v")
    if not name:
        if task.simulate:
            raise GdgError(
                f"'{task.group.hand}' on '{task.group.object_name}': the grasps were never tested, "
                f"so {task.file} names no protocol to simulate; leave --simulate out."
            )
        return None
    try:
        protocol = load_protocol(name)
    except GdgError:
        protocol = None
    if protocol is not None and str(protocol.version) == version:
        return protocol
    missing = f"{task.group.protocol} is no protocol that this version of gdg has"
    if task.simulate:
        raise GdgError(f"{missing}, so its grasps can't be simulated; leave --simulate out.")
    notes.append(f"{missing}, so drive targets were not computed.")
    return None


def _simulator() -> Simulator:
    record = get_registry().find("simulator", DEFAULTS["simulator"])
    return record.load()(record.options())


def _measured(hand: HandModel, obj: ObjectModel, grasps: GraspSet) -> GraspSet:
    from gdg.quality import measure

    return measure(hand, obj, grasps)


def skipped(results: Sequence[RebuildResult]) -> list[str]:
    """Why groups were left out, each reason once, with the number of grasps' groups."""
    reasons: dict[str, int] = {}
    for result in results:
        for line in filter(None, result.reason.splitlines()):
            reasons[line] = reasons.get(line, 0) + 1
    return [f"{reason}{f' ({n} pairs)' if n > 1 else ''}" for reason, n in reasons.items()]
