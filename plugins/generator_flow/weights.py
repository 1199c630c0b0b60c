"""Weights of the network: reading and writing them, with the network's size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from gdg.errors import GdgError
from gdg.weights_files import (
    WeightsFile,
    check_state,
    find_weights,
    read_weights,
    write_weights,
)

from .network import FlowNetwork
from .options import FlowOptions

SCHEMA = "gdg-flow-1"
BUNDLED = Path(__file__).parent / "weights"
#: Metadata entry of the network's size.
SIZE_KEY = "network"
SIZES = ("width", "layers", "heads")


@dataclass(frozen=True)
class Weights:
    """A network's weights and what is known of them.

    Attributes:
        file: tensors and metadata.
        distance: ``name/preset`` of the distance whose maps it was trained on.
        size: of the network; see ``FlowOptions``.
        provenance: training objects and hands, and hashes.
    """

    file: WeightsFile
    distance: str
    size: dict[str, int]
    provenance: dict[str, Any]

    def network(self) -> FlowNetwork:
        """The network with these weights, in evaluation mode.

        Raises:
            GdgError: a tensor is missing, too many, of another shape, or not finite.
        """
        network = FlowNetwork(**self.size)
        state = {name: tensor.float() for name, tensor in self.file.state.items()}
        check_state(self.file.path, state, network.state_dict())
        network.load_state_dict(state)
        return network.eval()


def load_weights(given: str) -> Weights:
    """Weights by bundled name or path.

    Raises:
        GdgError: no such weights, or a file that can't be read as weights of this network.
    """
    path = find_weights(given, BUNDLED, "generator.weights")
    file = read_weights(path, SCHEMA, {"distance": "which distance it was trained with"})
    provenance = dict(file.metadata)
    distance, size = provenance.pop("distance"), _size(path, provenance.pop(SIZE_KEY, None))
    return Weights(file, distance, size, provenance)


def save_weights(path: Path, network: FlowNetwork, metadata: Mapping[str, Any]) -> None:
    """Writes a safetensors file in half precision, atomically.

    Args:
        path: ends in ``.safetensors``.
        network: whose tensors are written.
        metadata: JSON values; ``distance`` is required, the rest becomes the provenance.
    """
    known = {**metadata, SIZE_KEY: network.size}
    write_weights(path, network.state_dict(), SCHEMA, known, dtype=torch.float16)


def _size(path: Path, found: object) -> dict[str, int]:
    """The network's size, within what the options allow: a file can't ask for endless memory."""
    try:
        assert isinstance(found, dict)
        assert set(found) == set(SIZES)
        return FlowOptions.model_validate(found).model_dump(include=set(SIZES))
    except (AssertionError, ValueError) as error:
        raise GdgError(
            f"{path}: its metadata doesn't say how large the network is; export it with "
            f"'gdg train'."
        ) from error
