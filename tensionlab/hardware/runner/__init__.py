"""Runs: their demands, guards, cycles, clocks and results."""
