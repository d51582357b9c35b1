"""One-way brakes: cones, choice, contact, maps."""
