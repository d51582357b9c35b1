"""Comparison of solvers on a rig: selected solvers, scores, replay of a run."""
