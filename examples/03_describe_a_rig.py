"""Describe your own rig, save it, and load it again."""

import tempfile
from pathlib import Path

import tensionlab as tl

corners = {"front-left": (-1, 0, 1), "front-right": (1, 0, 1), "back": (0, 0, -1), "ceiling": (0, 2.4, 0)}
modules = tuple(tl.Module(name, anchor, lower=0.5, upper=6.0) for name, anchor in corners.items())
rig = tl.Rig("my-rig", "point", modules, home=(0.0, 1.0, 0.0), up="y")

file = Path(tempfile.mkdtemp()) / "my-rig.toml"
tl.save_rig(rig, file)
print(file.read_text())
assert tl.load_rig(file) == rig
