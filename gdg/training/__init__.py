"""Training of contact-map generators on grasp datasets."""
