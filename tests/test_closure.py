"""Fingers close until they touch, and no further."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pytest
import torch
from conftest import build_model
from gripper import OPEN_M, write_gripper

from gdg.closure import STEPS, TOUCH_M, close_until_touch, moved_links
from gdg.hands.hand import load_hand
from gdg.hands.spec import MANIFEST
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.rotations import IDENTITY_ROT6D

#: Half the cube's edge, and how far the jaws' base lies below its middle, metres.
HALF_CUBE_M, BELOW_M = 0.02, 0.035
#: What one step closes, metres.
STEP_M = OPEN_M / STEPS
