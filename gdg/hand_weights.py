"""Weights of networks that were trained for one hand: found by the hand, refused by others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import nn

from gdg.errors import GdgError, MissingWeights
from gdg.hands.hand import Hand
from gdg.identity import body_hash
from gdg.weights_files import (
    SUFFIX,
    WeightsFile,
    check_state,
    find_weights,
    read_weights,
    write_weights,
)

#: What the metadata must say, as texts.
REQUIRED = {
    "distance": "which distance it was trained with",
    "hand": "which hand it was trained for",
    "hand_body": "which body that hand has",
    "root_link": "which link's pose it gives",
}


@dataclass(frozen=True)
class HandWeights:
    """The weights that a planner brings along, one file per hand, and how it stores more.

    Attributes:
        folder: where the bundled files lie; it may be missing.
        planner: the planner's name, for messages.
        schema: of the files.
    """

    folder: Path
    planner: str
    schema: str

    def load(self, given: str, hand: Hand) -> WeightsFile:
        """The weights that a bundled name or a path means, or, of "", those of the hand.

        Bundled weights belong to a hand by its joints and shapes, whatever their file is called.

        Raises:
            MissingWeights: there are none.
            GdgError: they can't be read, or they belong to another hand.
        """
        if given:
            found = self._read(find_weights(given, self.folder, "planner.weights"))
            self._check_hand(found, hand)
            return found
        body = body_hash(hand)
        for path in sorted(self.folder.glob(f"*{SUFFIX}")):
            found = self._read(path)
            if found.metadata["hand_body"] == body:
                self._check_hand(found, hand)
                return found
        raise MissingWeights(
            f"planner '{self.planner}' has no weights for the hand '{hand.name}' in "
            f"{hand.folder}: train them with '{self.train_command(hand)}' and give "
            f"planner.weights=PATH of the {SUFFIX} file that it writes."
        )

    def provenance(self, found: WeightsFile) -> dict[str, Any]:
        """What a grasp set records of the planner's weights."""
        return {
            "planner": self.planner,
            "weights": found.path.name,
            "weights_sha256": found.sha256,
            "training": found.metadata,
        }

    def save(self, path: Path, network: nn.Module, hand: Hand, metadata: Mapping[str, Any]) -> None:
        """Writes a network's tensors in half precision, with the hand that they belong to.

        Args:
            path: ends in ``.safetensors``.
            network: whose state is written.
            hand: that it was trained for.
            metadata: JSON values; ``distance`` is required.
        """
        facts = {
            "hand": hand.name,
            "hand_body": body_hash(hand),
            "root_link": hand.spec.root_link,
            "joint_names": list(hand.spec.joints),
        }
        state = network.state_dict()
        write_weights(path, state, self.schema, {**metadata, **facts}, torch.float16)

    def _read(self, path: Path) -> WeightsFile:
        return read_weights(path, self.schema, REQUIRED)

    def _check_hand(self, found: WeightsFile, hand: Hand) -> None:
        known = found.metadata
        if (
            known["hand_body"] == body_hash(hand)
            and known["root_link"] == hand.spec.root_link
            and known.get("joint_names") == list(hand.spec.joints)
        ):
            return
        other = ", one with other joints or shapes" if known["hand"] == hand.name else ""
        raise GdgError(
            f"{found.path}: these weights are for the hand '{known['hand']}'{other}, not for "
            f"'{hand.name}' in {hand.folder}; train some with '{self.train_command(hand)}'."
        )

    def train_command(self, hand: Hand) -> str:
        """The command that trains weights for a hand, for messages."""
        return f"gdg train planner={self.planner} hand={hand.name} data=DATASET"


def load_network(found: WeightsFile, network: nn.Module) -> None:
    """Copies tensors into a network and puts it into evaluation mode.

    Raises:
        GdgError: a tensor is missing, too many, of another shape, or not finite.
    """
    check_state(found.path, found.state, network.state_dict())
    network.load_state_dict(dict(found.state))
    network.eval()
