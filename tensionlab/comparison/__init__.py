"""Comparison of solvers on a rig, and replay of a run by other solvers."""
