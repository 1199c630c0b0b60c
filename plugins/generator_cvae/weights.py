"""Weights of the network: reading and writing them, with where they come from.

Ours are safetensors files whose metadata holds one JSON text under ``gdg``. The authors' released
``.pth`` files are read too, as plain tensors only: nothing in them is ever executed.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from gdg import weights_files
from gdg.errors import GdgError
from gdg.weights_files import State, check_state, checked_bytes, read_weights, write_weights

from . import release
from .network import PointNetCvae

SCHEMA = "gdg-cvae-1"
BUNDLED = Path(__file__).parent / "weights"
#: Suffixes beside ``.safetensors`` -> what such a file is.
OTHER_SUFFIXES = {".pth": "a released .pth file"}


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
        check_state(self.path, self.state, network.state_dict(), _shown)
        network.load_state_dict(dict(self.state))
        return network.eval()


def find_weights(given: str) -> Path:
    """The file that a bundled name or a path means.

    Raises:
        MissingWeights: no weights of that name are bundled.
        GdgError: there is no such file.
    """
    return weights_files.find_weights(given, BUNDLED, "generator.weights", OTHER_SUFFIXES)


def load_weights(given: str) -> Weights:
    """Weights by bundled name or path; see ``find_weights``.

    Raises:
        GdgError: no such weights, or a file that can't be read as tensors of this network.
    """
    path = find_weights(given)
    if path.suffix in OTHER_SUFFIXES:
        sha256 = hashlib.sha256(checked_bytes(path)).hexdigest()
        return Weights(
            path, sha256, _read_released(path), release.DISTANCE, release.provenance(sha256)
        )
    read = read_weights(path, SCHEMA, {"distance": "which distance it was trained with"})
    metadata = dict(read.metadata)
    return Weights(path, read.sha256, read.state, metadata.pop("distance"), metadata)


def save_weights(path: Path, network: PointNetCvae, metadata: Mapping[str, Any]) -> None:
    """Writes a safetensors file atomically.

    Args:
        path: ends in ``.safetensors``.
        network: whose tensors are written.
        metadata: JSON values; ``distance`` is required, the rest becomes the provenance.
    """
    write_weights(path, network.state_dict(), SCHEMA, metadata)


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


def _shown(name: str) -> str:
    return f"'{name}' (in released files '{release.TENSOR_NAMES[name]}')"
