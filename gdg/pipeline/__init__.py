"""The main jobs: plan and test grasps, evaluate grids, synthesise datasets."""
