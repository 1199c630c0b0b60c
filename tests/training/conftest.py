"""One thread, and a small dataset."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from training_samples import some_grasps

from gdg.data.dataset import write_shard
from gdg.hands.hand import find_hand
from gdg.objects.model import find_object


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Tensors this small only wait for each other's threads, for long on a busy machine."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three train objects with 12 barrett grasps each."""
    root, hand = tmp_path_factory.mktemp("synth"), find_hand("barrett")
    for seed, name in enumerate(("cube_small", "lemon", "orange")):
        obj = find_object(name)
        facts = {
            "hand_hash": hand.content_hash,
            "object_hash": obj.content_hash,
            "split": obj.split,
        }
        write_shard(root, "k", some_grasps("barrett", name, 12, seed), facts)
    return root
