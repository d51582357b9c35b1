"""How many examples a test draws: few fixed ones as a rule, many new ones with HYPOTHESIS_PROFILE=nightly."""

import os

PROFILES = {"ci": 0.2, "nightly": 10.0}  # number of examples of each profile, as a share of what a test asks for
PROFILE = os.environ.get("HYPOTHESIS_PROFILE", "ci")
# No profile takes less than this of what a test asks for: the first that hypothesis draws is all zeros.
ENOUGH_TO_MEAN_SOMETHING = 5


def many(count: int, least: int = ENOUGH_TO_MEAN_SOMETHING) -> int:
    """Scale a number of random examples to the profile."""
    return max(min(count, least), round(count * PROFILES[PROFILE]))
