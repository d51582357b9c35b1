"""Calibration: tension per ampere of a module, zero of cable lengths, and anchors of a rig."""
