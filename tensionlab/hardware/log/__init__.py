"""Logs of runs: their columns, their files, and their reader."""
