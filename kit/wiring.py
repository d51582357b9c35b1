"""Draw the wiring of a module: ``python -m kit.wiring`` writes kit/wiring.svg.

Pins of the ESP32 are named here by constants of the firmware: board.hpp and boards/shield_2.hpp of firmware/esp32
have their numbers.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from xml.sax.saxutils import escape

HERE = Path(__file__).parent
FILE = HERE / "wiring.svg"
ESP32 = HERE.parent / "firmware" / "esp32"
BOARD_FILES = (ESP32 / "board.hpp", ESP32 / "boards" / "shield_2.hpp")
WIDTH, HEIGHT = 1000, 850
POWER, FIVE_VOLTS, THREE_VOLTS, MOTOR, SIGNAL, GROUND = (
    "#b3261e",
    "#a15c00",
    "#8e24aa",
    "#1f6f43",
    "#1257a0",
    "#222",
)

Point = tuple[float, float]


@dataclass(frozen=True)
class Box:
    """A part with terminals on its edges: their names, and where they are along the edge."""

    title: tuple[str, ...]
    x: int
    y: int
    width: int
    height: int
    left: dict[str, int] = field(default_factory=dict)
    right: dict[str, int] = field(default_factory=dict)
    top: dict[str, int] = field(default_factory=dict)
    bottom: dict[str, int] = field(default_factory=dict)
    title_y: int = 0  # of its first line

    def terminal(self, name: str) -> Point:
        """Return where a terminal is."""
        for positions, x in ((self.left, self.x), (self.right, self.x + self.width)):
            if name in positions:
                return x, positions[name]
        for positions, y in ((self.top, self.y), (self.bottom, self.y + self.height)):
            if name in positions:
                return positions[name], y
        raise KeyError(f"{self.title[0]} has no terminal {name}")


@dataclass(frozen=True)
class Symbol:
    """A part with two ends, by the middle of its symbol, and its label."""

    kind: str
    x: int
    y: int
    upright: bool
    label: tuple[str, ...]
    label_x: int
    label_y: int
    anchor: str = "start"


@dataclass(frozen=True)
class Text:
    """A line of text, and the point where it begins, has its middle or ends."""

    words: str
    x: float
    y: float
    anchor: str = "start"
    size: int = 14
    bold: bool = False

    def bounds(self) -> tuple[float, float, float, float]:
        """Return left, top, right and bottom of the text, as a common font has them."""
        width = len(self.words) * self.size * (0.58 if self.bold else 0.54)
        left = self.x - {"start": 0.0, "middle": 0.5, "end": 1.0}[self.anchor] * width
        return left, self.y - 0.75 * self.size, left + width, self.y + 0.2 * self.size


def in_rows(names: tuple[str, ...]) -> dict[str, int]:
    """Return terminals one below the other."""
    return {name: 306 + 32 * row for row, name in enumerate(names)}


# Where the ESP32's pins go: to the shield's headers, as its solder pads are set, and to the encoder's board.
SHIELD_PADS = {
    "kPhaseA": "9: PWM A", "kPhaseB": "5: PWM B", "kPhaseC": "6: PWM C", "kEnable": "8: enable",
    "kSenseA": "A0: current A", "kSenseB": "A2: current B", "3V3": "3.3V", "GND": "GND",
}  # fmt: skip
ENCODER_PADS = {
    "kClock": "CLK", "kFromEncoder": "MISO", "kToEncoder": "MOSI", "kSelectEncoder": "CSn",
    "3V3": "3.3V", "GND": "GND",
}  # fmt: skip
SOLDER_PADS = {
    "PWM A: 9": True, "PWM B: 5": True, "PWM C: 6": True, "enable: 8": True, "current A: A0": True,
    "current B: A2": True, "ADC range: 3.3 V": True, "voltage regulator": False, "encoder pull-ups": False,
    "I2C pull-ups": False,
}  # fmt: skip
BOXES = {
    "supply": Box(("12 V supply",), 30, 45, 120, 85, right={"+": 80, "−": 108}, bottom={"to F2": 58}, title_y=66),
    "shield": Box(
        ("SimpleFOC shield v2.0.x",), 280, 240, 200, 330,
        left={"TB_M1 a": 370, "TB_M1 b": 402, "TB_M1 c": 434}, right=in_rows(tuple(SHIELD_PADS.values())),
        top={"TB_PWR +": 330, "TB_PWR −": 425}, title_y=284,
    ),
    "motor": Box(("GM3506", "motor"), 90, 335, 110, 130, right={"a": 370, "b": 402, "c": 434}, title_y=357),
    "converter": Box(
        ("5 V converter",), 30, 600, 140, 100, top={"IN +": 58}, right={"OUT +": 640},
        bottom={"IN −": 65, "OUT −": 130}, title_y=670,
    ),
    "servo": Box(
        ("DS2312 servo",), 300, 600, 140, 100,
        left={"+": 640}, right={"signal": 640}, bottom={"−": 370}, title_y=622,
    ),
    "ESP32": Box(
        ("ESP32-DevKitC",), 650, 240, 170, 460, left=in_rows(tuple(SHIELD_PADS)) | {"kServo": 640},
        right=in_rows(tuple(f"{name} " for name in ENCODER_PADS)), top={"kSupply": 735},
        bottom={"USB": 735}, title_y=284,
    ),
    "encoder": Box(
        ("AS5048A", "encoder"), 890, 240, 90, 270, left=in_rows(tuple(ENCODER_PADS.values())), title_y=262
    ),
}  # fmt: skip
SYMBOLS = (
    Symbol("switch", 225, 80, False, ("S1 emergency stop,", "one for all modules"), 240, 40, "middle"),
    Symbol("fuse", 360, 80, False, ("F1 3 A slow",), 360, 60, "middle"),
    Symbol("capacitor", 480, 115, True, ("C1 bulk", "1000 µF, 35 V"), 502, 112),
    Symbol("clamp", 625, 115, True, ("D1 clamp", "1.5KE15A"), 644, 112),
    Symbol("resistor", 735, 110, True, ("R1 100 kΩ",), 750, 115),
    Symbol("resistor", 800, 180, True, ("R2 10 kΩ",), 815, 185),
    Symbol("fuse", 58, 230, True, ("F2 1 A slow",), 74, 235),
)


@cache
def pins() -> dict[str, int]:
    """Return the pins of the board by the names of their constants."""
    text = re.sub(r"//.*", "", "".join(path.read_text(encoding="utf-8") for path in BOARD_FILES))
    declared = "\n".join(re.findall(r"constexpr Pin .*?;", text, re.DOTALL))
    return {name: int(number) for name, number in re.findall(r"(k\w+) = (\d+)[,;]", declared)}


def label(terminal: str) -> str:
    """Return what is written at a terminal."""
    name = terminal.strip()
    return f"GPIO {pins()[name]}" if name in pins() else name


def wires() -> list[tuple[str, Sequence[Point]]]:
    """Return the wires: their colours and corners. Symbols lie on them."""
    at = {name: box.terminal for name, box in BOXES.items()}
    found: list[tuple[str, Sequence[Point]]] = [
        (POWER, [at["supply"]("+"), (205, 80)]),
        (POWER, [(245, 80), (340, 80)]),
        (POWER, [(380, 80), (735, 80), (735, 90)]),
        (POWER, [(330, 205), at["shield"]("TB_PWR +")]),
        (POWER, [(400, 80), (400, 205), (330, 205)]),
        *((POWER, [(x, 80), (x, 95)]) for x in (480, 625)),
        (POWER, [at["supply"]("to F2"), (58, 210)]),
        (POWER, [(58, 250), at["converter"]("IN +")]),
        (POWER, [(290, 80), (290, 110)]),
        (FIVE_VOLTS, [at["converter"]("OUT +"), at["servo"]("+")]),
        *((MOTOR, [at["shield"](f"TB_M1 {phase}"), at["motor"](phase)]) for phase in "abc"),
        (SIGNAL, [at["ESP32"]("kServo"), at["servo"]("signal")]),
        (SIGNAL, [(735, 130), at["ESP32"]("kSupply")]),
        (SIGNAL, [(735, 145), (800, 145), (800, 160)]),
        (SIGNAL, [at["ESP32"]("USB"), (735, 725)]),
    ]
    for pads, part, end in ((SHIELD_PADS, "shield", ""), (ENCODER_PADS, "encoder", " ")):
        colours = {"3V3": THREE_VOLTS, "GND": GROUND}
        found += [(colours.get(pin, SIGNAL), [at["ESP32"](pin + end), at[part](pad)]) for pin, pad in pads.items()]
    return found


def grounds() -> list[Point]:
    """Return where ground symbols hang, below the terminals that have one."""
    at = {name: box.terminal for name, box in BOXES.items()}
    x, y = at["shield"]("TB_PWR −")
    ends = [
        at["converter"]("IN −"),
        at["converter"]("OUT −"),
        at["servo"]("−"),
        (480, 135),
        (625, 135),
        (800, 200),
    ]
    return [*ends, (165, 108), (x + 35, y - 32)]


def texts() -> list[Text]:
    """Return all text of the drawing."""
    found = [Text("Wiring of one module", 30, 24, size=16, bold=True), Text("motor supply", 500, 72)]
    for box in BOXES.values():
        middle = box.x + box.width / 2
        found += [
            Text(line, middle, box.title_y + 18 * row, "middle", bold=True) for row, line in enumerate(box.title)
        ]
        found += [Text(label(name), box.x + 8, y + 5) for name, y in box.left.items()]
        found += [Text(label(name), box.x + box.width - 8, y + 5, "end") for name, y in box.right.items()]
        found += [Text(label(name), x, box.y + 18, "middle") for name, x in box.top.items()]
        found += [Text(label(name), x, box.y + box.height - 8, "middle") for name, x in box.bottom.items()]
    for symbol in SYMBOLS:
        found += [
            Text(line, symbol.label_x, symbol.label_y + 17 * row, symbol.anchor)
            for row, line in enumerate(symbol.label)
        ]
    found += [
        Text("to all modules", 290, 125, "middle"),
        Text("USB: its power, and the link", 735, 742, "middle"),
        Text(f"GPIO {pins()['kPairButton']}: its BOOT button", 735, 570, "middle", 12),
        Text(f"GPIO {pins()['kThermistor']}: thermistor", 735, 590, "middle", 12),
        Text("Solder pads under the shield", 30, 765, bold=True),
        Text("filled: closed, empty: open", 262, 765),
        Text("Ground: all meet at one point, TB_PWR −", 970, 765, "end"),
    ]
    for place, name in enumerate(SOLDER_PADS):
        found.append(Text(name, 54 + 190 * (place % 5), 797 + 28 * (place // 5)))
    return found


def symbol_paths(symbol: Symbol) -> str:
    """Return a symbol as SVG, 40 long."""
    turn = " rotate(90)" if symbol.upright else ""
    shapes = {
        "fuse": '<path d="M-20 0H20"/><rect x="-13" y="-6" width="26" height="12" fill="none"/>',
        "resistor": '<path d="M-20 0H-13M13 0H20"/><rect x="-13" y="-5" width="26" height="10" fill="none"/>',
        "capacitor": '<path d="M-20 0H-4M-4 -12V12M4 -12V12M4 0H20"/><path d="M-14 -11H-8M-11 -14V-8"/>',
        # The bar of a suppressor diode, with its bent ends, is towards the supply.
        "clamp": '<path d="M-20 0H-8M8 0H20M-8 -11V11M-8 -11H-12M-8 11H-4"/><path d="M-8 0L8 -9V9Z" fill="#222"/>',
        # Normally closed: the contact rests on the far side of its stop.
        "switch": '<path d="M-20 0H-12L14 6M12 8V0H20"/><path d="M0 3V-12M-7 -12H7" stroke-dasharray="3 2"/>',
    }
    return f'<g transform="translate({symbol.x} {symbol.y}){turn}" stroke="#222">{shapes[symbol.kind]}</g>'


def drawing() -> str:
    """Return the drawing as SVG."""
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        'font-family="Arial, Helvetica, sans-serif" stroke-width="2" fill="none" stroke-linejoin="round">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>',
    ]
    for box in BOXES.values():
        size = f'width="{box.width}" height="{box.height}"'
        lines.append(f'<rect x="{box.x}" y="{box.y}" {size} rx="6" fill="#f4f4f2" stroke="#222"/>')
    for colour, corners in wires():
        lines.append(f'<path d="M{"L".join(f"{x:g} {y:g}" for x, y in corners)}" stroke="{colour}"/>')
    lines += [symbol_paths(symbol) for symbol in SYMBOLS]
    x, y = BOXES["shield"].terminal("TB_PWR −")
    lines.append(f'<path d="M150 108H165M{x:g} {y:g}v-32h35" stroke="{GROUND}"/>')
    lines += [f'<path d="M{x:g} {y:g}v10m-11 0h22m-18 5h14m-10 5h6" stroke="{GROUND}"/>' for x, y in grounds()]
    joints = [(290, 80), (400, 80), (480, 80), (625, 80), (735, 145)]
    lines += [f'<circle cx="{x}" cy="{y}" r="4" fill="#222"/>' for x, y in joints]
    for place, closed in enumerate(SOLDER_PADS.values()):
        x, y = 34 + 190 * (place % 5), 786 + 28 * (place // 5)
        filling = "#222" if closed else "#fff"
        lines.append(f'<rect x="{x}" y="{y}" width="12" height="12" fill="{filling}" stroke="#222"/>')
    for text in texts():
        weight = ' font-weight="bold"' if text.bold else ""
        lines.append(
            f'<text x="{text.x:g}" y="{text.y:g}" text-anchor="{text.anchor}" font-size="{text.size}"{weight} '
            f'fill="#222">{escape(text.words)}</text>'
        )
    return "\n".join([*lines, "</svg>", ""])


if __name__ == "__main__":
    FILE.write_text(drawing(), encoding="utf-8", newline="\n")
    print(f"wiring: {FILE}")
