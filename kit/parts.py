"""Print what the parts of one module cost, and what of them is to be measured: ``python -m kit.parts``."""

from __future__ import annotations

import csv
import re
from pathlib import Path

FILE = Path(__file__).with_suffix(".csv")
PARAMETERS = Path(__file__).with_name("parameters.py")


def read_parts() -> list[dict[str, str]]:
    """Return the rows of the bill of materials."""
    with FILE.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def cost(part: dict[str, str]) -> float:
    """Return what the quantity of a part costs, in EUR."""
    return float(part["quantity"]) * float(part["price_eur"])


def total() -> float:
    """Return what all parts of one module cost, in EUR."""
    return sum(map(cost, read_parts()))


def bill() -> str:
    """Return the bill of materials with its total, as a table in Markdown."""
    parts = read_parts()
    lines = ["| Part | Quantity | What matters | EUR |", "| --- | --- | --- | --- |"]
    for part in parts:
        lines.append(f"| {part['part']} | {part['quantity']} | {part['specification']} | {cost(part):.2f} |")
    return "\n".join([*lines, f"| **Total**, estimated {parts[0]['price_date']} | | | **{total():.2f}** |"])


def measures() -> str:
    """Return the dimensions that depend on bought parts, as a table in Markdown."""
    text = PARAMETERS.read_text(encoding="utf-8")
    found = re.findall(r"^(\w+) = ([\d.]+)  # measure yours(?:: (.*))?$", text, re.MULTILINE)
    lines = ["| Parameter | Assumed | What to measure |", "| --- | --- | --- |"]
    return "\n".join([*lines, *(f"| `{name}` | {value} | {what} |" for name, value, what in found)])


if __name__ == "__main__":
    print(bill(), measures(), sep="\n\n")
