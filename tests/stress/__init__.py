"""Fuzzing, hostile clients, soaks and exact oracles: longer than tests; `make` has a target for each."""
