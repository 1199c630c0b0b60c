"""Weights files that say what the tables want to know, without a network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from gdg.weights_files import write_weights

#: Objects of ``train_objects`` are on no table; ``two_jaws`` is held out.
SAID: dict[str, Any] = {
    "distance": "aligned/release",
    "hands": ["barrett"],
    "held_out_hands": ["two_jaws"],
    "hand_hashes": {"barrett": "b" * 64},
    "train_objects": ["banana"],
    "validation_objects": ["contactdb+torus_small"],
    "object_hashes": {"banana": "1" * 64, "contactdb+torus_small": "2" * 64},
}


def write_row_weights(path: Path, **said: Any) -> Path:
    """Writes a file that says ``SAID`` but for what is given; None leaves an entry out."""
    path.parent.mkdir(parents=True, exist_ok=True)
    known = {key: value for key, value in {**SAID, **said}.items() if value is not None}
    write_weights(path, {"a": torch.zeros(1)}, "gdg-test-1", known)
    return path
