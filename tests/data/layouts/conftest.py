"""A small dataset of the two-jaw gripper on bundled objects, and what finds them again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from layout_datasets import write_dataset

from gdg.data.layouts.lookup import Lookup
from gdg.hands.hand import Hand
from gdg.objects.model import find_object


@pytest.fixture
def lookup(gripper: Hand) -> Lookup:
    """Finds the gripper under whatever name."""
    return Lookup(hands={"two_jaws": str(gripper.folder)})


@pytest.fixture
def dataset(gripper: Hand, tmp_path: Path) -> Callable[..., Path]:
    """Writes a dataset of random grasps on the given objects."""

    def write(*objects: str, count: int = 5, tested: bool = True) -> Path:
        hashes = {name: find_object(name).content_hash for name in objects}
        return write_dataset(tmp_path / "dataset", gripper, hashes, count, tested)

    return write
