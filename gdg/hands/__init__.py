"""What a hand is: its folder, its URDF, its collision geometry."""
