"""Write the printed parts as STEP and STL to out/kit, and pictures of them: ``python -m kit.build``.

With ``--pictures`` the pictures go to kit/pictures instead, where kit/README.md shows them.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from build123d import Pos, export_step, export_stl
from build123d.topology import Part
from matplotlib.figure import Figure
from PIL import Image

from kit.assembly import assembled, printed
from kit.parts import total
from kit.render import picture

OUT = Path("out/kit")
COMMITTED = Path(__file__).parent / "pictures"
COLOURS = {
    "spool": "#e8a33d", "ratchet": "#c8553d", "pawl": "#4d7ea8", "bracket": "#d9d9d4", "magnet-mount": "#7fa36b",
    "cable-guide": "#7fa36b", "tub": "#b9c4c9", "cover": "#b9c4c9", "breakaway-link": "#c8553d",
    "motor": "#6f6f78", "encoder": "#3f7f5f", "magnet": "#333340", "pin": "#9a9aa5", "servo": "#55606e",
    "horn": "#f4f4f0", "cable": "#222222",
}  # fmt: skip
STEPS = {
    "1  magnet and motor": ("magnet", "magnet-mount", "motor"),
    "2  motor on the bracket": ("magnet", "magnet-mount", "motor", "bracket"),
    "3  encoder below": ("bracket", "magnet-mount", "magnet", "encoder"),
    "4  ratchet under the spool": ("ratchet", "spool"),
    "5  pin, pawl and servo": ("bracket", "motor", "pin", "pawl", "servo", "horn"),
    "6  spool on the rotor": ("bracket", "motor", "pin", "pawl", "servo", "horn", "spool", "ratchet", "cable"),
    "7  tub below": ("tub", "bracket", "motor", "pin", "pawl", "servo", "horn", "spool", "ratchet", "cable"),
    "8  cover and guide": ("tub", "bracket", "cover", "cable-guide", "cable"),
}
BELOW = ("1  magnet and motor", "3  encoder below", "4  ratchet under the spool")
EYE = (-55.0, 32.0)  # azimuth and elevation, in degrees


def sheet(panels: dict[str, Any], columns: int) -> Figure:
    """Return a figure of pictures with their titles."""
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(2.6 * columns, 2.45 * rows), dpi=130, layout="constrained")
    for axes, (title, image) in zip(
        figure.subplots(rows, columns, squeeze=False).flat, panels.items(), strict=False
    ):
        axes.imshow(image)
        axes.set_title(title, fontsize=9)
    for axes in figure.axes:
        axes.axis("off")
    return figure


def coloured(parts: dict[str, Part], names: tuple[str, ...]) -> list[tuple[Part, str]]:
    """Return parts with their colours."""
    return [(parts[name], COLOURS[name]) for name in names]


def exploded(parts: dict[str, Part]) -> list[tuple[Part, str]]:
    """Return all parts, moved apart along the motor's axis."""
    lifts = {
        "tub": -70, "encoder": -28, "magnet": -14, "bracket": 0, "magnet-mount": 14, "motor": 26, "pin": 12,
        "servo": 30, "horn": 42, "pawl": 40, "ratchet": 60, "spool": 85, "cable-guide": 180, "cover": 180,
    }  # fmt: skip
    return [(Pos(0, 0, lift) * parts[name], COLOURS[name]) for name, lift in lifts.items()]


def brake_from_above() -> dict[str, Any]:
    """Return pictures of the brake from above: laid on, and lifted by the horn."""
    found = {}
    for title, lifted in (("laid on: the cable reels in only", False), ("lifted by the horn: free", True)):
        parts = assembled(lifted)
        names = ("ratchet", "pawl", "pin", "servo", "horn", "motor", "cable")
        found[title] = picture(coloured(parts, names), -90.0, 90.0)
    return found


def write_pictures(folder: Path) -> None:
    """Write the pictures, in few colours: they stay small."""
    folder.mkdir(parents=True, exist_ok=True)
    parts = assembled() | printed()
    figures = {
        "parts": sheet({name: picture([(part, COLOURS[name])], *EYE) for name, part in printed().items()}, 3),
        "brake": sheet(brake_from_above(), 2),
        "assembly": sheet(
            {
                title: picture(coloured(parts, names), EYE[0], -EYE[1] if title in BELOW else EYE[1])
                for title, names in STEPS.items()
            },
            4,
        ),
        "exploded": sheet({"": picture(exploded(parts), *EYE, size=(480, 1000))}, 1),
    }
    figures["exploded"].set_size_inches(4.0, 8.0)
    for name, figure in figures.items():
        file = folder / f"{name}.png"
        figure.savefig(file)
        Image.open(file).convert("RGB").quantize(128).save(file, optimize=True)


def main() -> None:
    """Write all files."""
    OUT.mkdir(parents=True, exist_ok=True)
    for name, part in printed().items():
        export_step(part, OUT / f"{name}.step")
        export_stl(part, OUT / f"{name}.stl")
    write_pictures(COMMITTED if "--pictures" in sys.argv else OUT)
    print(f"{len(printed())} parts as STEP and STL, and pictures: {OUT}")
    print(f"all parts of a module: {total():.2f} EUR, estimated; python -m kit.parts lists them")


if __name__ == "__main__":
    main()
