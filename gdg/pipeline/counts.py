"""What became of the candidates of a shard, or of many: counts and seconds by stage. Light."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class ShardCounts:
    """How many candidates went into each stage, and why the others did not.

    Attributes:
        candidates: what the planner tried.
        planned: what it gave.
        tested: what was simulated, after the exact filter.
        passed: what passed the simulation.
        rejected: reason of the planner or the filter -> candidates.
        failed: reason of the simulator -> grasps.
        seconds: stage -> seconds.
    """

    candidates: int = 0
    planned: int = 0
    tested: int = 0
    passed: int = 0
    rejected: Mapping[str, int] = field(default_factory=dict)
    failed: Mapping[str, int] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)

    @property
    def yield_rate(self) -> float:
        """Passing grasps per candidate."""
        return self.passed / max(1, self.candidates)

    @property
    def success_rate(self) -> float:
        """Passing grasps per simulated one."""
        return self.passed / max(1, self.tested)

    def commonest_loss(self) -> str:
        """The reason for which most candidates were lost, in quotes, or ""."""
        reasons = Counter(dict(self.rejected))
        reasons.update({f"{reason} in simulation": n for reason, n in self.failed.items()})
        most = reasons.most_common(1)
        return f"'{most[0][0]}'" if most and most[0][1] else ""

    def as_dict(self) -> dict[str, Any]:
        """Plain values, as they stand in a shard's provenance and in ``synth.json``."""
        return {
            "candidates": self.candidates,
            "planned": self.planned,
            "tested": self.tested,
            "passed": self.passed,
            "yield_rate": round(self.yield_rate, 6),
            "rejected": dict(self.rejected),
            "failed": dict(self.failed),
            "seconds": {stage: round(value, 4) for stage, value in self.seconds.items()},
        }

    @classmethod
    def from_dict(cls, tree: Mapping[str, Any]) -> ShardCounts:
        """The inverse of ``as_dict``.

        Raises:
            KeyError: an entry is missing.
        """
        names = ("candidates", "planned", "tested", "passed", "rejected", "failed", "seconds")
        return cls(**{name: tree[name] for name in names})


def total(counts: Iterable[ShardCounts]) -> ShardCounts:
    """The sum over shards."""
    listed = list(counts)
    return ShardCounts(
        sum(c.candidates for c in listed),
        sum(c.planned for c in listed),
        sum(c.tested for c in listed),
        sum(c.passed for c in listed),
        _added(c.rejected for c in listed),
        _added(c.failed for c in listed),
        _added(c.seconds for c in listed),
    )


def _added(tables: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    added: dict[str, Any] = {}
    for table in tables:
        for name, value in table.items():
            added[name] = added.get(name, 0) + value
    return added
