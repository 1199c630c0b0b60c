"""Generalizable dexterous grasping: any robot hand, any object, stable grasps in seconds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gdg.errors import GdgError

if TYPE_CHECKING:
    from gdg.api import evaluate, grasp

__version__ = "0.1.0"
__all__ = ["GdgError", "evaluate", "grasp"]


def __getattr__(name: str) -> Any:
    # on first use: pytest imports this package in every run of every project where it is installed
    if name in ("evaluate", "grasp"):
        import gdg.api

        return getattr(gdg.api, name)
    raise AttributeError(f"module 'gdg' has no attribute '{name}'")
