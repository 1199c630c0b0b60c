"""Training of the selection network, as a Lightning module."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from lightning.pytorch import LightningModule
from torch import Tensor

from gdg.kinds.hand_model import HandModel
from gdg.training.batches import GraspBatch

from .fingers import Touched, fingers_of, touched
from .network import ContactSelection

#: Points so far from the true contact count as right, too, standard deviation, metres.
BLUR_M = 0.005
#: A finger so far off the object says little about where it would touch, metres.
NEAR_M = 0.01


class UniGraspModule(LightningModule):
    """The selection network, taught each stage with the true contacts of the stages before it.

    Args:
        hand: the hand that is trained for; it stays where it is, on the CPU.
        learning_rate: of Adam.
        seed: of the initial weights.
    """

    def __init__(self, hand: HandModel, learning_rate: float, seed: int):
        super().__init__()
        self.hand, self.fingers = hand, fingers_of(hand)
        self.network = ContactSelection(len(self.fingers))
        self.network.initialise(torch.Generator().manual_seed(seed))
        self._learning_rate = learning_rate

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Adam on all weights."""
        return torch.optim.Adam(self.parameters(), lr=self._learning_rate)

    def training_step(self, batch: GraspBatch, batch_index: int) -> Tensor:
        """The mean cross-entropy of the stages, nats."""
        loss, stages = self._losses(batch)
        self._log(batch, train_loss=loss.detach(), **_named("train", stages))
        return loss

    def validation_step(self, batch: GraspBatch, batch_index: int) -> None:
        """Logs the same on objects never trained on."""
        loss, stages = self._losses(batch)
        self._log(batch, val_recon=loss, **_named("val", stages))

    def _losses(self, batch: GraspBatch) -> tuple[Tensor, Float[Tensor, "finger"]]:
        true = self._touched(batch)
        scene = self.network.scene(batch.points, batch.normals)
        weight = torch.exp(-(true.gap / NEAR_M).square())
        entropies = torch.stack(
            [
                cross_entropy(stage(scene, true.index[:, :number]), batch.points, where)
                for number, (stage, where) in enumerate(zip(self.network.stages, true.index.T))
            ],
            dim=-1,
        )
        stages = (weight * entropies).sum(0) / weight.sum(0).clamp(min=1e-6)
        return (weight * entropies).sum() / weight.sum().clamp(min=1e-6), stages.detach()

    @torch.no_grad()
    def _touched(self, batch: GraspBatch) -> Touched:
        hand, pads = self.hand, self.fingers.pads
        poses = hand.link_poses(batch.q.to(hand.device))
        placed = hand.place(poses, pads.points, pads.link_index)
        return touched(self.fingers, placed.to(batch.points.device), batch.points)

    def _log(self, batch: GraspBatch, **values: Tensor) -> None:
        size = len(batch.q)
        self.log_dict(dict(values), on_step=False, on_epoch=True, batch_size=size, sync_dist=True)


def cross_entropy(
    scores: Float[Tensor, "batch object_point"],
    points: Float[Tensor, "batch object_point 3"],
    index: Int[Tensor, "batch"],
) -> Float[Tensor, "batch"]:
    """Cross-entropy of the scores' softmax with the true points, blurred over their neighbours."""
    true = points.gather(1, index[:, None, None].expand(-1, 1, 3))
    apart = (points - true).square().sum(-1)
    wanted = torch.softmax(-apart / (2 * BLUR_M**2), dim=-1)
    return -(wanted * torch.log_softmax(scores, dim=-1)).sum(-1)


def _named(which: str, stages: Tensor) -> dict[str, Tensor]:
    return {f"{which}_stage{number + 1}": value for number, value in enumerate(stages)}
