"""What a dataset holds, summed up from footers. Light."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from gdg.data.shards import ShardInfo, read_info, shard_files
from gdg.errors import GdgError


@dataclass
class Summary:
    """Sums over some shards.

    Attributes:
        shards: files.
        grasps: rows in them.
        tested: grasps that were simulated, those that were not stored included.
        passed: stored grasps that passed.
        tested_passed: grasps that passed, of shards that say how many were tested.
        bytes: on disk.
        splits: of the objects.
        versions: of the schema.
        seeds: that the grasps were made with.
        reasons: why shards are empty.
        measured: column -> (count, sum).
    """

    shards: int = 0
    grasps: int = 0
    tested: int = 0
    passed: int = 0
    tested_passed: int = 0
    bytes: int = 0
    splits: set[str] = field(default_factory=set)
    versions: set[int] = field(default_factory=set)
    seeds: set[int] = field(default_factory=set)
    reasons: set[str] = field(default_factory=set)
    measured: dict[str, tuple[int, float]] = field(default_factory=dict)

    def add(self, info: ShardInfo) -> None:
        """Adds one shard."""
        passed = info.passed if info.version > 1 else _passed_of_old(info)
        self.shards += 1
        self.grasps += info.count
        self.bytes += info.path.stat().st_size
        self.passed += passed or 0
        self.splits.add(info.split)
        self.versions.add(info.version)
        self.reasons |= {info.reason} - {""}
        tested = _count_in(info, "tested", info.count if passed is not None else 0)
        if tested:
            self.tested += tested
            self.tested_passed += _count_in(info, "passed", passed or 0)
        seed = info.provenance.get("seed")
        self.seeds |= {seed} if isinstance(seed, int) else set()
        for name, (count, total) in info.measured.items():
            before = self.measured.get(name, (0, 0.0))
            self.measured[name] = before[0] + count, before[1] + total

    @property
    def success_rate(self) -> float | None:
        """Share of the tested grasps that passed; None where none was tested."""
        return self.tested_passed / self.tested if self.tested else None

    def mean(self, name: str) -> float | None:
        """Mean of a measured column over the grasps that passed; None where there is none."""
        count, total = self.measured.get(name, (0, 0.0))
        return total / count if count else None

    def as_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "shards": self.shards,
            "grasps": self.grasps,
            "tested": self.tested,
            "passed": self.passed,
            "success_rate": self.success_rate,
            "bytes": self.bytes,
            "splits": sorted(self.splits),
            "schema_versions": sorted(self.versions),
            "seeds": sorted(self.seeds),
            "reasons": sorted(self.reasons),
            "means": {name: self.mean(name) for name in sorted(self.measured)},
        }


@dataclass(frozen=True)
class DatasetInfo:
    """What a dataset holds.

    Attributes:
        pairs: (hand, object) -> its sums.
        unreadable: one sentence per file that is no shard.
    """

    pairs: dict[tuple[str, str], Summary]
    unreadable: tuple[str, ...]

    def by_hand(self) -> dict[str, Summary]:
        """Sums per hand."""
        return self._by(0)

    def by_object(self) -> dict[str, Summary]:
        """Sums per object."""
        return self._by(1)

    def total(self) -> Summary:
        """Sums of everything."""
        return join(self.pairs.values())

    def _by(self, index: int) -> dict[str, Summary]:
        names = sorted({pair[index] for pair in self.pairs})
        return {
            name: join(sums for pair, sums in self.pairs.items() if pair[index] == name)
            for name in names
        }


def dataset_info(root: Path) -> DatasetInfo:
    """Sums up a dataset from the footers of its shards; only of old ones a column is read.

    Raises:
        GdgError: there is no such folder.
    """
    pairs: dict[tuple[str, str], Summary] = {}
    unreadable = []
    for path in shard_files(root):
        try:
            info = read_info(path)
            pairs.setdefault(info.pair, Summary()).add(info)
        except GdgError as error:
            unreadable.append(str(error))
    return DatasetInfo(dict(sorted(pairs.items())), tuple(unreadable))


def join(parts: Iterable[Summary]) -> Summary:
    """The sums of several sums."""
    total = Summary()
    for part in parts:
        for name in ("shards", "grasps", "tested", "passed", "tested_passed", "bytes"):
            setattr(total, name, getattr(total, name) + getattr(part, name))
        for name in ("splits", "versions", "seeds", "reasons"):
            getattr(total, name).update(getattr(part, name))
        for name, (count, value) in part.measured.items():
            before = total.measured.get(name, (0, 0.0))
            total.measured[name] = before[0] + count, before[1] + value
    return total


def _count_in(info: ShardInfo, name: str, default: int) -> int:
    """A count in the provenance, which may hold anything."""
    value = info.provenance.get(name, default)
    return value if isinstance(value, int) and value >= 0 else 0


def _passed_of_old(info: ShardInfo) -> int | None:
    """Schema 1 doesn't count them in its footer; None where no grasp was tested."""
    with pq.ParquetFile(info.path) as stored:
        if "success" not in stored.schema_arrow.names:
            return None
        return stored.read(columns=["success"])["success"].combine_chunks().true_count
