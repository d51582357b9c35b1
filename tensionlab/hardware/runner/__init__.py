"""The parts of a run: what goes through it, what guards it, when it goes on and how it went."""
