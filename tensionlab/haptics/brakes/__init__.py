"""One-way brakes: choice, contact, maps."""
