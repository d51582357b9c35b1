"""Runs that compare solvers and rigs, and the records they leave."""
