"""Weights of the network: reading and writing them, with where they come from.

Ours are safetensors files whose metadata holds one JSON text under ``gdg``. The authors' released
``.pth`` files are read too, as plain tensors only: nothing in them is ever executed.
"""

from __future__ import annotations

import hashlib
import json
import pickle
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import safetensors
import torch
from safetensors import torch as safetensors_torch
from torch import Tensor

from gdg.data.atomic import atomic_path
from gdg.errors import GdgError, did_you_mean

from . import release
from .network import PointNetCvae

SCHEMA = "gdg-cvae-1"
METADATA_KEY = "gdg"
BUNDLED = Path(__file__).parent / "weights"
#: The network has 2.8 MB; a file far beyond that is something else.
MAX_BYTES = 64 * 2**20

State = Mapping[str, Tensor]


@dataclass(frozen=True)
class Weights:
    """A network's weights and what is known of them.

    Attributes:
        path: the file.
        sha256: of the file.
        state: tensors by our names.
        distance: ``name/preset`` of the distance whose maps it was trained on.
        provenance: training objects and hands, hashes, or the release's name.
    """

    path: Path
    sha256: str
    state: State
    distance: str
    provenance: dict[str, Any] = field(default_factory=dict)

    def network(self) -> PointNetCvae:
        """The network with these weights, in evaluation mode.

        Raises:
            GdgError: a tensor is missing, too many, of another shape, or not finite.
        """
        network = PointNetCvae()
        _check(self.path, self.state, network.state_dict())
        network.load_state_dict(dict(self.state))
        return network.eval()


def find_weights(given: str) -> Path:
    """The file that a bundled name or a path means.

    Raises:
        GdgError: there is no such name or file, or it has another suffix.
    """
    path = Path(given).expanduser()
    if path.suffix not in (".safetensors", ".pth"):
        bundled = {file.stem: file for file in BUNDLED.glob("*.safetensors")}
        if given in bundled:
            return bundled[given]
        hint = did_you_mean(given, bundled) or " No weights are bundled with this version."
        raise GdgError(
            f"generator.weights: there are no bundled weights '{given}'.{hint} Give the path of "
            f"a .safetensors file from 'gdg train', or of a released .pth file."
        )
    if not path.is_file():
        raise GdgError(f"generator.weights: there is no file '{given}'.")
    return path


def load_weights(given: str) -> Weights:
    """Weights by bundled name or path; see ``find_weights``.

    Raises:
        GdgError: no such weights, or a file that can't be read as tensors of this network.
    """
    path = find_weights(given)
    if path.stat().st_size > MAX_BYTES:
        raise GdgError(f"{path}: is larger than {MAX_BYTES >> 20} MB, so not this network's.")
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    if path.suffix == ".pth":
        return Weights(
            path, sha256, _read_released(path), release.DISTANCE, release.provenance(sha256)
        )
    state, metadata = _read_safetensors(path)
    return Weights(path, sha256, state, metadata.pop("distance"), metadata)


def save_weights(path: Path, network: PointNetCvae, metadata: Mapping[str, Any]) -> None:
    """Writes a safetensors file atomically.

    Args:
        path: ends in ``.safetensors``.
        network: whose tensors are written.
        metadata: JSON values; ``distance`` is required, the rest becomes the provenance.
    """
    text = json.dumps({"schema": SCHEMA, "distance": metadata["distance"], **metadata})
    state = {name: tensor.detach().cpu() for name, tensor in network.state_dict().items()}
    with atomic_path(path) as temporary:
        safetensors_torch.save_file(state, temporary, metadata={METADATA_KEY: text})


def _read_safetensors(path: Path) -> tuple[State, dict[str, Any]]:
    try:
        with safetensors.safe_open(path, framework="pt") as stored:
            metadata = json.loads((stored.metadata() or {}).get(METADATA_KEY, "null"))
            names = list(stored.keys())
            state = {name: stored.get_tensor(name) for name in names}
    except (safetensors.SafetensorError, OSError, ValueError) as error:
        raise GdgError(f"{path}: is no readable safetensors file: {error}") from error
    if not isinstance(metadata, dict) or not isinstance(metadata.get("distance"), str):
        raise GdgError(
            f"{path}: its metadata doesn't say which distance it was trained with; export it "
            f"with 'gdg train'."
        )
    if metadata.get("schema") != SCHEMA:
        raise GdgError(f"{path}: schema is '{metadata.get('schema')}', expected '{SCHEMA}'.")
    return state, {key: value for key, value in metadata.items() if key != "schema"}


def _read_released(path: Path) -> State:
    try:
        stored = torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        raise GdgError(
            f"{path}: refused, because it holds more than plain tensors and reading it could "
            f"run code; save it again as torch.save(model.state_dict(), …)."
        ) from error
    except (RuntimeError, OSError, EOFError, ValueError, KeyError, AttributeError) as error:
        raise GdgError(f"{path}: is no readable PyTorch file: {error}") from error
    if not isinstance(stored, Mapping) or not all(
        isinstance(tensor, Tensor) for tensor in stored.values()
    ):
        raise GdgError(f"{path}: holds no state dict, that is tensors by name.")
    ours = {theirs: name for name, theirs in release.TENSOR_NAMES.items()}
    state = {}
    for theirs, tensor in stored.items():
        name = str(ours.get(theirs, theirs))
        state[name] = release.to_our_layout(name, tensor)
    return state


def _check(path: Path, state: State, expected: State) -> None:
    for name, wanted in expected.items():
        shown = f"'{name}' (in released files '{release.TENSOR_NAMES[name]}')"
        if name not in state:
            raise GdgError(f"{path}: doesn't fit the network: tensor {shown} is missing.")
        found = state[name]
        if found.shape != wanted.shape:
            raise GdgError(
                f"{path}: doesn't fit the network: tensor {shown} has shape "
                f"{tuple(found.shape)} instead of {tuple(wanted.shape)}."
            )
        if not found.isfinite().all():
            raise GdgError(f"{path}: tensor {shown} holds numbers that are not finite.")
    for name in state:
        if name not in expected:
            raise GdgError(f"{path}: doesn't fit the network: it has no tensor '{name}'.")
