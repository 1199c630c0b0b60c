"""What a dataset's tables and pictures show: its pairs, read once, and figures of each.

Imported by ``dataset.py``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch

from gdg.data.dataset import read_shard, shards
from gdg.data.grasps import GraspSet
from gdg.hands.hand import find_hand
from gdg.kinds.hand_model import HandModel
from gdg.metrics import direction_coverage, distinct_grasps, joint_diversity
from gdg.pipeline.counts import ShardCounts, total
from gdg.pipeline.jobs import DEFAULTS
from gdg.registry import get_registry

#: Passing grasps that the recipe asks of a pair.
WANTED = 64
#: Stages of a shard, as its provenance names their seconds.
STAGES = ("plan", "filter", "simulate", "measure")


@dataclass
class PairFacts:
    """A hand-object pair of the dataset.

    Attributes:
        hand: its name.
        object_name: its name.
        passing: its passing grasps; None where it has none.
        counts: what became of its candidates.
        reason: why it was given up, or "".
        object_path: what its object is loaded by.
    """

    hand: str
    object_name: str
    passing: GraspSet | None = None
    counts: ShardCounts = field(default_factory=ShardCounts)
    reason: str = ""
    object_path: str = ""

    def __len__(self) -> int:
        return 0 if self.passing is None else len(self.passing)


def read_pairs(root: Path) -> list[PairFacts]:
    """Every pair that has a shard, sorted by hand and object."""
    reasons = _reasons(root)
    found: dict[tuple[str, str], list[tuple[ShardCounts, GraspSet]]] = {}
    paths: dict[tuple[str, str], str] = {}
    for info in shards(root):
        grasps = read_shard(info.path)
        counts = ShardCounts.from_dict(info.provenance)
        found.setdefault(info.pair, []).append((counts, grasps.select(grasps.passed)))
        paths[info.pair] = info.object_path or info.object_name
    return [
        PairFacts(
            *pair,
            passing=_joined([grasps for _, grasps in parts if len(grasps)]),
            counts=total(counts for counts, _ in parts),
            reason=reasons.get(pair, ""),
            object_path=paths[pair],
        )
        for pair, parts in sorted(found.items())
    ]


def hands_of(pairs: Sequence[PairFacts]) -> list[str]:
    """Names of the hands, sorted."""
    return sorted({pair.hand for pair in pairs})


@lru_cache
def hand_model(name: str) -> HandModel:
    """A hand with its kinematics."""
    record = get_registry().find("hand-model", DEFAULTS["hand_model"])
    return record.load()(record.options(), find_hand(name), torch.device("cpu"))


def metric(pairs: Sequence[PairFacts], name: str) -> np.ndarray:
    """Finite values of a metric over all passing grasps of some pairs."""
    parts = [pair.passing.metrics[name].numpy() for pair in pairs if pair.passing is not None]
    values = np.concatenate(parts) if parts else np.zeros(0)
    return values[np.isfinite(values)]


def tables(pairs: Sequence[PairFacts]) -> str:
    """All tables, in Markdown."""
    parts = [
        _by_hand("Grasps", GRASPS, pairs),
        _by_hand("Quality of the passing grasps", QUALITY, pairs),
        _by_hand("Diversity of the passing grasps", DIVERSITY, pairs),
        _by_hand("Time", TIME, pairs),
        _given_up(pairs),
    ]
    return "\n\n".join(parts)


Column = Callable[[Sequence[PairFacts]], str]


def _quantiles(name: str, *shares: float, digits: int = 2) -> Column:
    def text(pairs: Sequence[PairFacts]) -> str:
        values = metric(pairs, name)
        if not len(values):
            return "–"
        return " / ".join(f"{np.quantile(values, share):.{digits}f}" for share in shares)

    return text


def _share(name: str, least: float) -> Column:
    """Percentage of the grasps whose metric is at least so much."""

    def text(pairs: Sequence[PairFacts]) -> str:
        count = sum(map(len, pairs))
        return _percent((metric(pairs, name) >= least).sum(), count)

    return text


def _mean(measure: Callable[[PairFacts], float], digits: int = 2) -> Column:
    """Mean over the pairs with at least two passing grasps."""

    def text(pairs: Sequence[PairFacts]) -> str:
        values = [measure(pair) for pair in pairs if len(pair) > 1]
        return f"{np.mean(values):.{digits}f}" if values else "–"

    return text


def _count(which: Callable[[PairFacts], bool]) -> Column:
    return lambda pairs: f"{sum(map(which, pairs)):,}"


def _hours(*stages: str) -> Column:
    def text(pairs: Sequence[PairFacts]) -> str:
        return f"{_seconds(pairs, stages) / 3600:.2f}"

    return text


def _counts(pairs: Sequence[PairFacts]) -> ShardCounts:
    return total(pair.counts for pair in pairs)


def _seconds(pairs: Sequence[PairFacts], stages: Sequence[str]) -> float:
    spent = _counts(pairs).seconds
    return sum(spent.get(stage, 0.0) for stage in stages)


def _percent(part: float, whole: float) -> str:
    return f"{100 * part / whole:.1f}" if whole else "–"


def _rate(pairs: Sequence[PairFacts]) -> str:
    seconds = _seconds(pairs, STAGES)
    return f"{_counts(pairs).passed / seconds:.2f}" if seconds else "–"


def _coverage(pair: PairFacts) -> float:
    assert pair.passing is not None
    return direction_coverage(hand_model(pair.hand), pair.passing)


def _spread(pair: PairFacts) -> float:
    assert pair.passing is not None
    return joint_diversity(pair.passing)


def _pooled_spread(pairs: Sequence[PairFacts]) -> str:
    """Of all grasps of a hand as one set; several hands have no joints in common."""
    sets = [pair.passing for pair in pairs if pair.passing is not None]
    if len({grasps.hand for grasps in sets}) != 1 or sum(map(len, sets)) < 2:
        return "–"
    return f"{torch.cat([grasps.joints for grasps in sets]).std(0).mean():.3f}"


def _distinct(pairs: Sequence[PairFacts]) -> str:
    return f"{sum(distinct_grasps(p.passing) for p in pairs if p.passing is not None):,}"


GRASPS: dict[str, Column] = {
    "pairs": _count(lambda pair: True),
    f"with ≥ {WANTED}": _count(lambda pair: len(pair) >= WANTED),
    "with fewer": _count(lambda pair: 0 < len(pair) < WANTED),
    "with none": _count(lambda pair: not len(pair)),
    "passing grasps": lambda pairs: f"{sum(map(len, pairs)):,}",
    "candidates": lambda pairs: f"{_counts(pairs).candidates:,}",
    "yield %": lambda pairs: _percent(_counts(pairs).passed, _counts(pairs).candidates),
    "simulated": lambda pairs: f"{_counts(pairs).tested:,}",
    "of these pass %": lambda pairs: _percent(_counts(pairs).passed, _counts(pairs).tested),
}
QUALITY: dict[str, Column] = {
    "penetration mm: median / 95 % / max": _quantiles("penetration_mm", 0.5, 0.95, 1.0),
    "self-penetration mm: 95 % / max": _quantiles("self_penetration_mm", 0.95, 1.0),
    "contacts: median": _quantiles("contacts", 0.5, digits=0),
    "≥ 2 fingers %": _share("contact_fingers", 2),
    "≥ 3 fingers %": _share("contact_fingers", 3),
    "ε > 0 %": _share("epsilon", 1e-9),
    "ε: median / 95 %": _quantiles("epsilon", 0.5, 0.95, digits=3),
    "volume: median / 95 %": _quantiles("wrench_volume", 0.5, 0.95, digits=4),
    "residual: median / 95 %": _quantiles("wrench_residual", 0.5, 0.95, digits=3),
}
DIVERSITY: dict[str, Column] = {
    "joint std (rad)": _mean(_spread, 3),
    "pooled (rad)": _pooled_spread,
    "direction coverage": _mean(_coverage),
    "distinct grasps": _distinct,
    "passing grasps": lambda pairs: f"{sum(map(len, pairs)):,}",
}
TIME: dict[str, Column] = {
    **{f"{stage} h": _hours(stage) for stage in STAGES},
    "all h": _hours(*STAGES),
    "passing grasps per second of one worker": _rate,
}


def _by_hand(title: str, columns: dict[str, Column], pairs: Sequence[PairFacts]) -> str:
    groups = {hand: [p for p in pairs if p.hand == hand] for hand in hands_of(pairs)}
    rows = [
        [hand, *(column(group) for column in columns.values())] for hand, group in groups.items()
    ]
    rows.append(["all", *(column(pairs) for column in columns.values())])
    return f"**{title}**\n\n{_markdown(['hand', *columns], rows)}"


def _given_up(pairs: Sequence[PairFacts]) -> str:
    """Pairs with fewer grasps than wanted, and why."""
    short = [pair for pair in pairs if len(pair) < WANTED]
    if not short:
        return f"Every pair has at least {WANTED} passing grasps."
    rows = [
        [
            pair.hand,
            pair.object_name,
            str(len(pair)),
            f"{pair.counts.candidates:,}",
            _why(pair),
        ]
        for pair in short
    ]
    names = [
        "hand",
        "object",
        "passing grasps",
        "candidates",
        "most candidates lost to, or why it ended",
    ]
    title = f"<summary>{len(short)} pairs with fewer than {WANTED} passing grasps</summary>"
    return f"<details>{title}\n\n{_markdown(names, rows)}\n\n</details>"


def _why(pair: PairFacts) -> str:
    told = pair.reason
    if told and "mostly" not in told:
        return told
    return pair.counts.commonest_loss().strip("'") or "–"


def _markdown(names: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [names, ["---"] * len(names), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _reasons(root: Path) -> dict[tuple[str, str], str]:
    """Why pairs were given up, of ``synth.json`` where there is one."""
    record = root / "synth.json"
    entries: list[dict[str, str]] = []
    if record.is_file():
        entries = json.loads(record.read_text(encoding="utf-8"))["pairs"]
    return {(entry["hand"], entry["object"]): entry["reason"] for entry in entries}


def _joined(parts: Sequence[GraspSet]) -> GraspSet | None:
    """Poses, joints, metrics and verdicts of a pair's shards, one after the other."""
    if not parts:
        return None
    names = set.intersection(*(set(part.metrics) for part in parts))
    return replace(
        parts[0].select([]),
        poses=torch.cat([part.poses for part in parts]),
        joints=torch.cat([part.joints for part in parts]),
        targets=None,
        contacts=None,
        status=(),
        energies={},
        metrics={name: torch.cat([part.metrics[name] for part in parts]) for name in names},
        verdicts=tuple(verdict for part in parts for verdict in part.verdicts),
    )


def pairs_by_hand(pairs: Sequence[PairFacts]) -> Iterator[tuple[str, list[PairFacts]]]:
    """Hands with their pairs that have grasps."""
    for hand in hands_of(pairs):
        yield hand, [pair for pair in pairs if pair.hand == hand and len(pair)]
