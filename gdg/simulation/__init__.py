"""What every physics engine shares: trials, verdicts, mass, the hand's rigid bodies."""
