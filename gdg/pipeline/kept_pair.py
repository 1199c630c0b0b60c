"""The hand and the object that a worker process is asked for again and again."""

from __future__ import annotations

from gdg.config import RunConfig
from gdg.pipeline.pair import Pair

_kept: list[Pair] = []


def kept_pair(config: RunConfig) -> Pair:
    """The run's hand and object; loaded once, as long as no other run's are asked for."""
    if not _kept or _kept[0].config != config:
        _kept[:] = [Pair.load(config)]
    return _kept[0]


def forget_pair() -> None:
    """Frees the memory of the pair."""
    _kept.clear()
