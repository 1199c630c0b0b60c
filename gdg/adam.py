"""Adam (Kingma and Ba 2015) for poses that descend at run time."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.optim.adam import adam


class Adam:
    """``torch.optim.Adam``, step by step the same, but for gradients that are not finite.

    They count as zero: a pose that diverged must not spoil the others of its batch. And torch's own
    class would import torch's compiler, which takes longer than fitting a hand.

    Args:
        leaves: what is moved; their ``grad`` says where to.
        lr: the learning rate.

    Attributes:
        lr: of the next step.
    """

    def __init__(self, leaves: Sequence[Tensor], lr: float):
        self.lr = lr
        self._leaves = list(leaves)
        self._means = [torch.zeros_like(leaf) for leaf in leaves]
        self._squares = [torch.zeros_like(leaf) for leaf in leaves]
        self._steps = [torch.zeros(()) for _ in leaves]

    def zero_grad(self) -> None:
        """Forgets the gradients."""
        for leaf in self._leaves:
            leaf.grad = None

    @torch.no_grad()
    def step(self) -> None:
        """Moves every leaf; one without a gradient as if it were zero."""
        grads = [
            torch.zeros_like(leaf)
            if leaf.grad is None
            else leaf.grad.nan_to_num(nan=0.0, posinf=0.0, neginf=0.0)
            for leaf in self._leaves
        ]
        adam(
            self._leaves, grads, self._means, self._squares, [], self._steps, amsgrad=False,
            beta1=0.9, beta2=0.999, lr=self.lr, weight_decay=0.0, eps=1e-8, maximize=False,
        )  # fmt: skip
