"""Haptic rendering: effects, their stability, one-way brakes, and the bridge for game engines. Knows no device."""
