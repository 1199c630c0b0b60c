"""Files of network weights: safetensors with one JSON text that says what they are.

Every network of gdg that is trained stores its weights this way, and none of them executes
anything when it is read. A file's schema, ``gdg-cvae-1`` for instance, names the network that it
belongs to; the rest of its metadata says what it was trained on.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import safetensors
import torch
from safetensors import torch as safetensors_torch
from torch import Tensor

from gdg.data.atomic import atomic_path
from gdg.errors import GdgError, MissingWeights, did_you_mean

SUFFIX = ".safetensors"
#: The metadata entry that holds the JSON text.
METADATA_KEY = "gdg"
#: Networks of gdg have a few MB; a file far beyond that is something else.
MAX_BYTES = 64 * 2**20

State = Mapping[str, Tensor]


@dataclass(frozen=True)
class WeightsFile:
    """What a weights file holds.

    Attributes:
        path: the file.
        sha256: of the file.
        state: tensors by name, as stored.
        metadata: JSON values, without the schema.
    """

    path: Path
    sha256: str
    state: State
    metadata: dict[str, Any] = field(default_factory=dict)


def find_weights(
    given: str, bundled: Path, option: str, others: Mapping[str, str] | None = None
) -> Path:
    """The file that a bundled name or a path means.

    Args:
        given: what the user wrote; a path has the suffix ``.safetensors`` or one of ``others``.
        bundled: the folder of the bundled ``.safetensors`` files.
        option: where the user wrote it, e.g. ``generator.weights``.
        others: further suffixes -> what such a file is, for messages.

    Raises:
        MissingWeights: no weights of that name are bundled.
        GdgError: there is no such file.
    """
    path, others = Path(given).expanduser(), others or {}
    if path.suffix == SUFFIX or path.suffix in others:
        if not path.is_file():
            raise GdgError(f"{option}: there is no file '{given}'.")
        return path
    if path.is_file():
        raise GdgError(f"{option}: '{given}' is no {SUFFIX} file; it may be another component's.")
    known = {file.stem: file for file in bundled.glob(f"*{SUFFIX}")}
    if given in known:
        return known[given]
    hint = did_you_mean(given, known) or " No weights are bundled with this version."
    wanted = "".join(
        [f"a {SUFFIX} file from 'gdg train'", *(f", or of {what}" for what in others.values())]
    )
    raise MissingWeights(
        f"{option}: there are no bundled weights '{given}'.{hint} Give the path of {wanted}."
    )


def checked_bytes(path: Path) -> bytes:
    """A weights file's content.

    Raises:
        GdgError: it can't be read, or is larger than any network of gdg.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise GdgError(f"{path}: is larger than {MAX_BYTES >> 20} MB, so not this network's.")
        return path.read_bytes()
    except OSError as error:
        raise GdgError(f"{path}: can't be read: {error.strerror or error}") from error


def read_metadata(path: Path) -> dict[str, Any]:
    """What a weights file says of itself, the schema included; empty where it says nothing.

    Raises:
        GdgError: it is no readable safetensors file.
    """
    try:
        with safetensors.safe_open(path, framework="pt") as stored:
            metadata = json.loads((stored.metadata() or {}).get(METADATA_KEY, "null"))
    except (safetensors.SafetensorError, OSError, ValueError) as error:
        raise GdgError(f"{path}: is no readable safetensors file: {error}") from error
    return metadata if isinstance(metadata, dict) else {}


def read_weights(path: Path, schema: str, required: Mapping[str, str]) -> WeightsFile:
    """The tensors and metadata of a safetensors file; nothing in it is executed.

    Args:
        path: the file.
        schema: that it must have.
        required: metadata entries that must be texts -> what they say, for the message.

    Raises:
        GdgError: unreadable, too large, without metadata, or of another schema.
    """
    content, known = checked_bytes(path), read_metadata(path)
    try:
        state = safetensors_torch.load(content)
    except (safetensors.SafetensorError, ValueError, KeyError) as error:
        raise GdgError(f"{path}: is no readable safetensors file: {error}") from error
    for key, meaning in required.items():
        if not isinstance(known.get(key), str):
            raise GdgError(
                f"{path}: its metadata doesn't say {meaning}; export it with 'gdg train'."
            )
    if known.get("schema") != schema:
        raise GdgError(f"{path}: schema is '{known.get('schema')}', expected '{schema}'.")
    rest = {key: value for key, value in known.items() if key != "schema"}
    return WeightsFile(path, hashlib.sha256(content).hexdigest(), state, rest)


def write_weights(
    path: Path,
    state: State,
    schema: str,
    metadata: Mapping[str, Any],
    dtype: torch.dtype | None = None,
) -> None:
    """Writes a safetensors file atomically.

    Args:
        path: ends in ``.safetensors``.
        state: tensors by name.
        schema: names the network.
        metadata: JSON values.
        dtype: to store floating-point tensors in; by default as they are.
    """
    text = json.dumps({**metadata, "schema": schema})
    stored = {name: _stored(tensor, dtype) for name, tensor in state.items()}
    # not save_file, which makes a file of its own that no one else may read
    content = safetensors_torch.save(stored, metadata={METADATA_KEY: text})
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)


def check_state(
    path: Path, state: State, expected: State, shown: Callable[[str], str] = "'{}'".format
) -> None:
    """Checks that tensors fit a network.

    Args:
        path: where they come from, for messages.
        state: the tensors.
        expected: the network's own.
        shown: a tensor's name as messages show it.

    Raises:
        GdgError: a tensor is missing, too many, of another shape, or not finite.
    """
    for name, wanted in expected.items():
        if name not in state:
            raise GdgError(f"{path}: doesn't fit the network: tensor {shown(name)} is missing.")
        found = state[name]
        if found.shape != wanted.shape:
            raise GdgError(
                f"{path}: doesn't fit the network: tensor {shown(name)} has shape "
                f"{tuple(found.shape)} instead of {tuple(wanted.shape)}."
            )
        if not found.isfinite().all():
            raise GdgError(f"{path}: tensor {shown(name)} holds numbers that are not finite.")
    for name in state:
        if name not in expected:
            raise GdgError(f"{path}: doesn't fit the network: it has no tensor '{name}'.")


def _stored(tensor: Tensor, dtype: torch.dtype | None) -> Tensor:
    tensor = tensor.detach().cpu().contiguous()
    return tensor.to(dtype) if dtype is not None and tensor.is_floating_point() else tensor
