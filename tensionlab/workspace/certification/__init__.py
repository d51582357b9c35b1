"""Proved workspaces: cells of positions that are inside or outside for sure."""
