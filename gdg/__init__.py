"""Generalizable dexterous grasping: any robot hand, any object, stable grasps in seconds."""

from gdg.api import evaluate, grasp
from gdg.errors import GdgError

__version__ = "0.1.0"
__all__ = ["GdgError", "evaluate", "grasp"]
