"""What planners share whose network learned the grasps of one hand."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from torch import nn

from gdg.components import Options
from gdg.errors import GdgError
from gdg.hand_learner_options import HandLearnerOptions
from gdg.hand_weights import HandWeights, load_network
from gdg.kinds.hand_model import HandModel
from gdg.kinds.planner import Planner
from gdg.kinds.trainable import BatchKind, Trainable
from gdg.weights_files import WeightsFile

if TYPE_CHECKING:
    from lightning.pytorch import LightningModule

Network = TypeVar("Network", bound=nn.Module)


class HandLearner(Planner, Trainable, Generic[Network]):
    """A planner with a network that is trained for, and serves, one hand.

    Args:
        options: the component's options; none of them matters to training.

    Attributes:
        stored: how its weights are stored, and where those that it brings along lie.
    """

    batch_kind: ClassVar[BatchKind] = "grasps"
    stored: ClassVar[HandWeights]

    def __init__(self, options: HandLearnerOptions):
        super().__init__(options)
        self._given = options.weights
        self._loaded: dict[str, tuple[WeightsFile, Network]] = {}

    @abstractmethod
    def network_of(self, hand: HandModel) -> Network:
        """A network for a hand, its weights still to be loaded."""

    @classmethod
    @abstractmethod
    def module(cls) -> Callable[[HandModel, float, int], LightningModule]:
        """Makes what is trained from hand, learning rate and seed.

        It keeps the hand as ``hand`` and what is stored as ``network``. Import it here only:
        Lightning takes seconds.
        """

    def loaded(self, hand: HandModel) -> tuple[WeightsFile, Network]:
        """The weights that the options mean for a hand, and the network with them.

        They are read once for each hand.

        Raises:
            GdgError: there are none, they can't be read, or they belong to another hand.
        """
        key = f"{hand.hand.folder} {hand.hand.content_hash} {hand.device}"
        if key not in self._loaded:
            weights = self.stored.load(self._given, hand.hand)
            network = self.network_of(hand)
            load_network(weights, network)
            self._loaded[key] = weights, network.to(hand.device)
        return self._loaded[key]

    @classmethod
    def trainable(
        cls, options: Options, learning_rate: float, seed: int, hand: HandModel | None = None
    ) -> LightningModule:
        """A fresh network for one hand.

        Raises:
            GdgError: there is no hand, or the method allows none such.
        """
        if hand is None:
            raise GdgError(
                f"planner '{cls.stored.planner}' is trained for one hand; write hand=<its name>."
            )
        return cls.module()(hand, learning_rate, seed)

    @classmethod
    def export(cls, module: LightningModule, path: Path, metadata: Mapping[str, Any]) -> None:
        """Writes the network as safetensors in half precision."""
        hand, network = module.hand, module.network
        assert isinstance(hand, HandModel)
        assert isinstance(network, nn.Module)
        cls.stored.save(path, network, hand.hand, metadata)
