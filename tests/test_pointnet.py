"""Shared layers treat all points alike."""

from __future__ import annotations

import torch

from gdg.pointnet import SharedMlp, initialise, mlp


def network() -> SharedMlp:
    made = SharedMlp(3, 8, 5)
    initialise(made, torch.Generator().manual_seed(0))
    return made.eval()


@torch.no_grad()
def test_permuted_points_give_permuted_features():
    points = torch.randn(2, 10, 3, generator=torch.Generator().manual_seed(1))
    order = torch.randperm(10, generator=torch.Generator().manual_seed(2))
    torch.testing.assert_close(network()(points[:, order]), network()(points)[:, order])


@torch.no_grad()
def test_a_batch_of_one_equals_the_batch():
    points = torch.randn(4, 10, 3, generator=torch.Generator().manual_seed(1))
    whole = network()(points)
    torch.testing.assert_close(network()(points[2:3]), whole[2:3])


def test_the_same_generator_state_gives_the_same_weights_and_no_layer_is_constant():
    first, second = network().state_dict(), network().state_dict()
    assert all(torch.equal(first[name], second[name]) for name in first)
    assert all(
        tensor.std() > 0 for name, tensor in first.items() if "linears" in name and "w" in name
    )


def test_layers_without_bias_can_be_initialised():
    layer = torch.nn.Linear(3, 4, bias=False)
    initialise(layer, torch.Generator().manual_seed(0))
    assert layer.bias is None


def test_an_mlp_ends_without_relu():
    assert [type(layer).__name__ for layer in mlp(2, 3, 4)] == ["Linear", "ReLU", "Linear"]
