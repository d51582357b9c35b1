"""Layouts: the space for modules, the objective, the search, and its tasks from files."""
