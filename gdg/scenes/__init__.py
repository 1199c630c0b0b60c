"""Scenes: what stands around an object while it is grasped."""
