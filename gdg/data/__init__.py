"""The data that travels between stages: contact maps, grasps, verdicts."""
