"""Which weights a row uses."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gdg.bench.recipes import folder_name, train_command
from gdg.bench.tables import Method
from gdg.config import RunConfig
from gdg.errors import GdgError, MissingWeights
from gdg.identity import Assets, body_hash
from gdg.pipeline.fingerprint import bundled_weights
from gdg.weights_files import checked_bytes, read_metadata


@dataclass(frozen=True)
class RowWeights:
    """The weights that a row uses.

    Attributes:
        name: component and name, as in ``cvae-without-barrett``.
        path: of the file.
        sha256: of the file.
        said: what its metadata says it was trained on.
    """

    name: str
    path: Path
    sha256: str
    said: Mapping[str, Any]

    def __str__(self) -> str:
        return f"{self.name} ({self.sha256[:12]})"

    @classmethod
    def of(cls, name: str, path: Path) -> RowWeights:
        """Those of a file.

        Raises:
            GdgError: it can't be read.
        """
        sha256 = hashlib.sha256(checked_bytes(path)).hexdigest()
        return cls(name, path, sha256, read_metadata(path))


def with_weights(
    method: Method, config: RunConfig, folder: str, assets: Assets
) -> tuple[RunConfig, RowWeights | None]:
    """A row's config with the row's weights, and which they are; None where it needs none.

    Args:
        method: the row.
        config: of the row, with any weights.
        folder: the user's folder of weights, or "".
        assets: where hands are looked up.

    Raises:
        MissingWeights: there are none; the message is the command that trains them.
        GdgError: there is no such folder, or a file in it can't be read.
    """
    if not (method.weights or method.planner_weights):
        return config, None
    key = "planner" if method.planner_weights else "generator"
    record = config.components[key].record
    name = folder_name(method, record.name)
    given = _in_folder(folder, name)
    if given is not None:
        return _with_option(config, key, str(given)), RowWeights.of(name, given)
    # without a name a planner takes those of the hand's body, whatever they are called
    found = [RowWeights.of(name, path) for path in bundled_weights(record, method.weights)]
    if method.planner_weights:
        body = body_of(method, assets)
        found = [weights for weights in found if weights.said.get("hand_body") == body]
    if not found:
        raise MissingWeights(train_command(method, record.name))
    return _with_option(config, key, method.weights), found[0]


def body_of(method: Method, assets: Assets) -> str | None:
    """Body hash of the row's hand; None where the hand can't be found."""
    hand = assets.hand(method.hand)
    return None if hand is None else body_hash(hand)


def _in_folder(folder: str, name: str) -> Path | None:
    if not folder:
        return None
    root = Path(folder).expanduser()
    if not root.is_dir():
        raise GdgError(f"weights={folder}: there is no such folder.")
    places = (root / f"{name}.safetensors", root / name / "model.safetensors")
    return next((path.resolve() for path in places if path.is_file()), None)


def _with_option(config: RunConfig, key: str, weights: str) -> RunConfig:
    """The config with a component's option ``weights`` set.

    Raises:
        GdgError: the component has no such option.
    """
    choice = config.components[key]
    if "weights" not in choice.record.options.model_fields:
        raise GdgError(
            f"{key}={choice.record.name}: has no option 'weights', which the table sets."
        )
    return config.with_options(key, weights=weights)
