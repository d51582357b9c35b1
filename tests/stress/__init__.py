"""Attempts to break the package: damaged files and frames, awkward problems, hostile clients, long runs."""

import os

SHARE = float(os.environ.get("TENSIONLAB_STRESS", "1"))  # of the usual cases; `make stress` asks for more


def cases(count: int) -> int:
    """Scale a number of cases."""
    return round(SHARE * count)
