"""Training of both networks, as a Lightning module."""

from __future__ import annotations

import torch
from jaxtyping import Float
from lightning.pytorch import LightningModule
from torch import Tensor

from gdg.kinds.hand_model import HandModel
from gdg.pads import contact_pads
from gdg.rotations import ROOT_DIM, rot6d_from_rotation, rotation_from_rot6d
from gdg.training.batches import GraspBatch
from gdg.training.randomness import step_generator

from . import loss
from .network import LATENT, GraspNetworks, center_of, thinned

#: Noise on true poses that ContactNet learns to see through: metres, rot6d, share of a range.
SHIFT_M, TURN, FLEX = 0.008, 0.08, 0.05


class GraspCvaeModule(LightningModule):
    """GraspCVAE with the paper's losses; ContactNet on predicted and on disturbed hands.

    Args:
        hand: the hand that is trained for; it stays where it is, on the CPU.
        learning_rate: of Adam.
        seed: of the initial weights, and, with the step's place in the run, of all noise.
    """

    def __init__(self, hand: HandModel, learning_rate: float, seed: int):
        super().__init__()
        self.network = GraspNetworks(hand)
        self.network.initialise(torch.Generator().manual_seed(seed))
        self.hand = hand
        self._pads = contact_pads(hand)
        self._learning_rate = learning_rate
        self._seed = seed

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Adam on all weights."""
        return torch.optim.Adam(self.parameters(), lr=self._learning_rate)

    def training_step(self, batch: GraspBatch, batch_index: int) -> Tensor:
        """The loss of a batch."""
        random = step_generator(self, self._seed, batch_index)
        noise = torch.randn(len(batch.q), LATENT, generator=random, device=self.device)
        disturbance = torch.randn(batch.q.shape, generator=random, device=self.device)
        terms = self._terms(batch, noise, disturbance)
        self._log(batch, "train", terms)
        return terms["loss"]

    def validation_step(self, batch: GraspBatch, batch_index: int) -> None:
        """Logs how well the latent's mean reconstructs grasps of objects never trained on.

        ``val_recon`` is the whole loss, KL divergence included: a network that reconstructs from
        latents far from the standard normal samples badly.
        """
        noise = batch.q.new_zeros(len(batch.q), LATENT)
        terms = self._terms(batch, noise, torch.zeros_like(batch.q))
        self._log(batch, "val", terms)
        self.log("val_recon", terms["loss"], batch_size=len(batch.q), sync_dist=True)

    def _terms(self, batch: GraspBatch, noise: Tensor, disturbance: Tensor) -> dict[str, Tensor]:
        """All terms, and ``loss``, their weighted sum."""
        cvae = self.network.cvae
        points, normals = batch.points, batch.normals
        hand_points, _ = self._placed(batch.q)
        condition = cvae.condition(points)
        mean, log_variance = cvae.encode(condition, points, thinned(hand_points))
        latent = mean + noise * (0.5 * log_variance).exp()
        q = cvae.decode(condition, center_of(points), latent)
        predicted, pads = self._placed(q)
        few, true = thinned(predicted), thinned(hand_points)
        beside = loss.nearest(points, few, pads)
        index = torch.cdist(true, points).argmin(1)
        terms = {
            "points_cm2": loss.surface_loss(hand_points, predicted),
            "parameters": loss.parameter_loss(batch.q, q, cvae.joint_half, cvae.grip),
            "kl": loss.kl_divergence(mean, log_variance),
            "consistency": loss.consistency_loss(points, true, few, index, beside.hand_of_object),
            "touch_cm": loss.touch_loss(pads, points, beside.object_of_pad),
            "penetration_cm": loss.penetration_loss(few, points, normals, beside.object_of_hand),
            "map": self._map_loss(batch, few.detach(), disturbance),
        }
        return {**terms, "loss": _weighted(terms)}

    def _map_loss(self, batch: GraspBatch, predicted: Tensor, disturbance: Tensor) -> Tensor:
        """ContactNet's error: half of the items see a disturbed true hand, half a predicted one."""
        disturbed, _ = self._placed(_disturbed(batch.q, disturbance, self.hand))
        odd = torch.arange(len(batch.q), device=batch.q.device) % 2 == 1
        seen = torch.where(odd[:, None, None], predicted, thinned(disturbed))
        return loss.map_loss(batch.values, self.network.contact(batch.points, seen))

    def _placed(
        self, q: Float[Tensor, "batch dof"]
    ) -> tuple[Float[Tensor, "batch hand_point 3"], Float[Tensor, "batch pad 3"]]:
        """Surface points and pads of the hand in the poses q, metres; the hand is on the CPU."""
        hand, pads = self.hand, self._pads
        poses = hand.link_poses(q.to(hand.device))
        placed = hand.place_surface(poses), hand.place(poses, pads.points, pads.link_index)
        return placed[0].to(q.device), placed[1].to(q.device)

    def _log(self, batch: GraspBatch, which: str, terms: dict[str, Tensor]) -> None:
        values = {f"{which}_{name}": value.detach() for name, value in terms.items()}
        size = len(batch.q)
        self.log_dict(values, on_step=False, on_epoch=True, batch_size=size, sync_dist=True)


def _weighted(terms: dict[str, Tensor]) -> Tensor:
    return (
        terms["points_cm2"]
        + loss.PARAMETER_WEIGHT * terms["parameters"]
        + loss.KL_WEIGHT * terms["kl"]
        + loss.CONTACT_WEIGHT * terms["consistency"]
        + loss.TOUCH_WEIGHT * terms["touch_cm"]
        + loss.PENETRATION_WEIGHT * terms["penetration_cm"]
        + loss.CONTACT_NET_WEIGHT * terms["map"]
    )


def _disturbed(q: Tensor, noise: Tensor, hand: HandModel) -> Tensor:
    """Poses a little off the true ones."""
    span = (hand.upper - hand.lower).to(q.device)
    rot6d = q[:, 3:ROOT_DIM] + TURN * noise[:, 3:ROOT_DIM]
    return torch.cat(
        (
            q[:, :3] + SHIFT_M * noise[:, :3],
            rot6d_from_rotation(rotation_from_rot6d(rot6d)),
            q[:, ROOT_DIM:] + FLEX * span * noise[:, ROOT_DIM:],
        ),
        dim=-1,
    )
