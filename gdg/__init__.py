"""Generalizable dexterous grasping: any robot hand, any object, stable grasps in seconds."""

__version__ = "0.1.0"
