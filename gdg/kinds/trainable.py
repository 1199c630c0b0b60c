"""Trainable: what ``gdg train`` can train, a generator or a planner."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from gdg.components import Options
from gdg.kinds.hand_model import HandModel

if TYPE_CHECKING:
    from lightning.pytorch import LightningModule

#: What a component learns from: ``gdg.training.batches.MapBatch`` of all hands together, or
#: ``GraspBatch`` of one hand.
BatchKind = Literal["maps", "grasps"]


class Trainable(ABC):
    """Mix-in of a generator or planner that learns.

    Attributes:
        batch_kind: which batches its training and validation steps get. A component that learns
            from ``grasps`` is trained for one hand.
        whole_surfaces: whether it learns only from surfaces as it gets them when it is used, all
            points of them and none hidden; ``gdg train`` then refuses settings that thin them out.
        follows_epochs: whether a step depends on how many epochs there will be, as a learning
            rate does that falls until the end; a run is then resumed with the same number only.
    """

    batch_kind: ClassVar[BatchKind]
    whole_surfaces: ClassVar[bool] = False
    follows_epochs: ClassVar[bool] = False

    @classmethod
    @abstractmethod
    def trainable(
        cls, options: Options, learning_rate: float, seed: int, hand: HandModel | None = None
    ) -> LightningModule:
        """A fresh network to be trained by ``gdg train``.

        Its steps get batches of the ``batch_kind``. ``validation_step`` must log ``val_recon``,
        the lower the better, by which the best epoch is chosen and training stops early.

        A resumed run has to equal an uninterrupted one to the bit, wherever in an epoch it was
        stopped. So a step may depend on the module's state dict, its optimiser's, the epoch, the
        number of the batch and the batch only. Draw random numbers from
        ``gdg.training.randomness.step_generator``, or from torch's global stream (dropout does),
        which ``gdg train`` seeds anew before every step; keep no ``torch.Generator`` as an
        attribute, and rely on no epoch hook to prepare it.

        Args:
            options: the component's options.
            learning_rate: of the optimiser.
            seed: of the initial weights and of all randomness in the steps.
            hand: the hand to be trained for, on the CPU; given if and only if the batches are of
                ``grasps``.

        Raises:
            GdgError: these options, or this hand, can't be trained with.
        """

    @classmethod
    @abstractmethod
    def export(cls, module: LightningModule, path: Path, metadata: Mapping[str, Any]) -> None:
        """Writes a trained module's weights to ``path`` (``.safetensors``), atomically.

        Args:
            module: what ``trainable`` gave, trained.
            path: the file to write; the component's ``weights`` option takes it.
            metadata: JSON values to store in the file: ``distance``, the label of the maps'
                distance, and where the training data came from.
        """
