"""Where and how well a rig can pull."""
