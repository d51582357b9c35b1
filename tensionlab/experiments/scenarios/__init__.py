"""Scenarios, played and judged: play, direction, feel."""
