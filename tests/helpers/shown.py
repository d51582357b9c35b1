"""Compare what documents show with what is printed: the same words, and numbers within a tolerance."""

import re

NUMBER = re.compile(r"-?\d+(\.\d+)?(e-?\d+)?")


def close(shown: str, printed: str) -> bool:
    """Whether two words are the same, or numbers that are: to 1e-6, or 2 %; whole numbers are counts."""
    if shown == printed:
        return True
    if not (NUMBER.fullmatch(shown) and NUMBER.fullmatch(printed)) or (shown.isdigit() and printed.isdigit()):
        return False
    return abs(float(shown) - float(printed)) <= max(1e-6, 0.02 * abs(float(printed)))


def differences(shown: str, printed: str) -> list[str]:
    """Lines of a shown table that a printed one has otherwise."""
    one, two = ([line.split() for line in text.splitlines()] for text in (shown, printed))
    if len(one) != len(two):
        return [f"{len(one)} lines shown, {len(two)} printed"]
    return [
        " ".join(line)
        for line, other in zip(one, two, strict=True)
        if len(line) != len(other) or not all(map(close, line, other))
    ]
