"""Our Adam takes torch's steps, and forgives gradients that are not finite."""

from __future__ import annotations

import math
import subprocess
import sys

import torch

from gdg.adam import Adam


def test_its_steps_are_those_of_torch():
    start = torch.randn(5, 3, generator=torch.Generator().manual_seed(0))
    ours, theirs = start.clone().requires_grad_(True), start.clone().requires_grad_(True)
    one, other = Adam([ours], 0.1), torch.optim.Adam([theirs], lr=0.1)
    for step in range(20):
        one.lr = other.param_groups[0]["lr"] = 0.1 / (1 + step)
        for leaf, optimiser in ((ours, one), (theirs, other)):
            optimiser.zero_grad()
            (leaf**4).sum().backward()
            optimiser.step()
    torch.testing.assert_close(ours, theirs, rtol=0, atol=1e-7)


def test_gradients_that_are_not_finite_or_missing_move_nothing():
    lost, sane, idle = (torch.ones(2).requires_grad_(True) for _ in range(3))
    optimiser = Adam([lost, sane, idle], 0.1)
    lost.grad = torch.tensor([math.nan, -math.inf])
    sane.grad = torch.tensor([1.0, -1.0])
    optimiser.step()
    assert lost.tolist() == idle.tolist() == [1.0, 1.0]
    torch.testing.assert_close(sane, torch.tensor([0.9, 1.1]))


def test_it_imports_no_compiler():
    code = (
        "import sys, torch; from gdg.adam import Adam; q = torch.ones(2, requires_grad=True);"
        "a = Adam([q], 0.1); q.sum().backward(); a.step();"
        "assert 'torch._dynamo' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
