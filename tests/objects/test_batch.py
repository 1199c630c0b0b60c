"""Objects side by side: each with its share of the hands."""

from __future__ import annotations

import torch

from gdg.objects.batch import ObjectBatch
from gdg.objects.model import ObjectModel, find_object


def test_what_belongs_to_objects_is_spread_over_their_hands(cube: ObjectModel):
    apple = find_object("apple")
    batch = ObjectBatch([cube, apple])
    assert len(batch) == 2
    spread = batch.per_hand(batch.reaches, 6)
    torch.testing.assert_close(spread, torch.tensor([cube.reach] * 3 + [apple.reach] * 3))
    centers = batch.per_hand(batch.centers_of_mass, 4)
    assert torch.equal(centers[:2], cube.center_of_mass.expand(2, 3))
    assert torch.equal(centers[2:], apple.center_of_mass.expand(2, 3))
    rows = torch.arange(12).reshape(6, 2)
    assert torch.equal(batch.per_object(rows), torch.stack((rows[:3], rows[3:])))
