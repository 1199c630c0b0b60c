"""What a run of ``gdg synth`` leaves beside its shards: its config, and statistics of the pairs."""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

import gdg
from gdg.config import RunConfig
from gdg.data.atomic import write_text_atomically
from gdg.pipeline.counts import total
from gdg.pipeline.schedule import PairState
from gdg.yaml_files import dump_yaml

SCHEMA = "gdg-synth-1"
RECORD = "synth.json"
#: The record is written this often while a run goes on, seconds.
PERIOD_S = 5.0
#: Settings that span pairs: in a recorded config they are lists.
SPANNING = ("hand", "object")


class _Pair(BaseModel):
    """What is read again of a pair's entry; the rest is kept as it is."""

    model_config = ConfigDict(strict=True, extra="allow", allow_inf_nan=False)

    hand: str
    object: str
    key: str
    timed_out: int | None = None
    timeout_s: float = 0.0


class _Record(BaseModel):
    model_config = ConfigDict(strict=True)

    version: str = Field(alias="schema")
    pairs: list[_Pair] = []


class SynthRecord:
    """``synth.json``: per pair what was made, what was lost where, and why it ended.

    Pairs of earlier runs in the same folder stay in it.

    Args:
        root: folder of the dataset.
        settings: how the run was set up, for readers.
    """

    def __init__(self, root: Path, settings: dict[str, Any]):
        self._path, self._settings = root / RECORD, settings
        self._started, self._written = time.time(), 0.0
        self._earlier = {pair["key"]: pair for pair in _read(self._path)}

    def timed_out(self, pair: PairState) -> tuple[int, float] | None:
        """The shard of the pair that took too long in an earlier run, and that run's limit."""
        entry = self._earlier.get(pair.task.key, {})
        number = entry.get("timed_out")
        return None if number is None else (number, float(entry.get("timeout_s", 0.0)))

    def save(self, pairs: Sequence[PairState], *, now: bool = False) -> None:
        """Writes the record, unless it was written a moment ago.

        Raises:
            OSError: it can't be written.
        """
        if not now and time.monotonic() - self._written < PERIOD_S:
            return
        entries = {**self._earlier, **{pair.task.key: _entry(pair) for pair in pairs}}
        tree = {
            "schema": SCHEMA,
            "gdg": gdg.__version__,
            "started": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(self._started)),
            "seconds": round(time.time() - self._started, 1),
            **self._settings,
            "pairs": sorted(entries.values(), key=lambda e: (e["hand"], e["object"], e["key"])),
        }
        write_text_atomically(self._path, json.dumps(tree, indent=1) + "\n")
        self._written = time.monotonic()


def _entry(pair: PairState) -> dict[str, Any]:
    counts = total(pair.counts[number] for number in range(pair.in_turn))
    return {
        "hand": pair.hand,
        "object": pair.object_name,
        "key": pair.task.key,
        "n": pair.job.n,
        "shards": pair.in_turn,
        "ended": pair.ended,
        "reason": str(pair.error or pair.reason),
        "timed_out": pair.timed_out,
        "timeout_s": pair.job.shard_timeout_s,
        **counts.as_dict(),
    }


def _read(path: Path) -> list[dict[str, Any]]:
    """The pairs of the record, or nothing where there is none or it can't be understood."""
    try:
        record = _Record.model_validate_json(path.read_bytes())
    except (OSError, ValidationError):
        return []
    return [pair.model_dump() for pair in record.pairs] if record.version == SCHEMA else []


def write_configs(root: Path, configs: Sequence[RunConfig]) -> list[Path]:
    """Writes ``config.yaml``, which ``gdg synth -c`` repeats; gives the files.

    Hands and objects are lists in it. Sweeps over anything else make further files,
    ``config-2.yaml`` and so on.

    Raises:
        OSError: a file can't be written.
    """
    groups: dict[str, list[dict[str, Any]]] = {}
    for config in configs:
        tree = config.as_tree()
        rest = {key: value for key, value in tree.items() if key not in SPANNING}
        groups.setdefault(dump_yaml(rest), []).append(tree)
    files = []
    for number, trees in zip(itertools.count(1), groups.values(), strict=False):
        spans = {key: list(dict.fromkeys(tree[key] for tree in trees)) for key in SPANNING}
        files.append(root / ("config.yaml" if number == 1 else f"config-{number}.yaml"))
        write_text_atomically(files[-1], dump_yaml({**trees[0], **spans}))
    return files
