"""The package for Unity: what it sends is in the schema and, compiled by Mono, it drives a real bridge."""

import json
import queue
import re
import shutil
import subprocess
import threading
from pathlib import Path

import pytest

from tests.haptics.bridge.test_real_clients import HANGS_S, ROOT, served

PACKAGE = ROOT / "examples" / "unity"
STUB = Path(__file__).with_name("unity")  # a stub of UnityEngine, and a scene that is played by commands
DEFINITIONS = json.loads((ROOT / "examples/bridge/schema.json").read_text(encoding="utf-8"))["$defs"]
SOFT = {"Wall": "stiffness 20", "Textured": "stiffness 20", "Shaped": "shape Box", "Weight": "mass 0.05"}


def test_effects_have_the_parameters_of_the_schema():
    """Each kind has its component, and what that sends is in the schema."""
    sources = {path.stem: path.read_text(encoding="utf-8") for path in PACKAGE.glob("Runtime/Effects/*Effect.cs")}
    kinds = DEFINITIONS["Effect"]["properties"]["kind"]["enum"]
    assert set(sources) == {f"{kind.capitalize()}Effect" for kind in kinds} | {"HapticEffect"}
    for kind in kinds:
        keys = set(re.findall(r'parameters\["(\w+)"\]', sources[f"{kind.capitalize()}Effect"]))
        assert keys <= set(DEFINITIONS[kind]["properties"])


def test_every_file_of_the_package_has_an_identity_of_its_own():
    """Without one, Unity leaves out what comes by a URL; scenes find scripts by it."""
    found = [
        path
        for path in PACKAGE.rglob("*")
        if path.suffix != ".meta" and "Samples~" not in (path.name, path.parent.name)
    ]
    texts = [path.with_name(path.name + ".meta").read_text(encoding="utf-8") for path in found]
    identities = {re.search(r"^guid: ([0-9a-f]{32})$", text, re.MULTILINE).group(1) for text in texts}
    assert len(identities) == len(found)


@pytest.mark.skipif(not (shutil.which("mcs") and shutil.which("mono")), reason="no Mono here")
@pytest.mark.realtime  # a server and a game, each a process
def test_a_game_drives_the_bridge(tmp_path):
    program = tmp_path / "player.exe"
    sources = [*STUB.glob("*.cs"), *PACKAGE.glob("Runtime/**/*.cs"), *PACKAGE.glob("Samples~/**/*.cs")]
    subprocess.run(["mcs", "-warnaserror", f"-out:{program}", *map(str, sources)], check=True)
    with (
        served() as (url, _),
        subprocess.Popen(
            ["mono", str(program), f"{url}/command"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as game,
    ):
        lines, heard = queue.Queue(), []
        threading.Thread(target=lambda: [lines.put(line.rstrip()) for line in game.stdout]).start()

        def do(*commands):
            game.stdin.write("".join(f"{command}\n" for command in commands))
            game.stdin.flush()

        def hear(pattern):
            while not (heard and (match := re.search(pattern, heard[-1]))):
                heard.append(lines.get(timeout=HANGS_S))
            heard.append("")
            return match

        def until(*force):
            while True:  # in N, in Unity's axes
                do("state")
                words = hear(r"^state: .*desired \((.*?)\)").group(1)
                if [float(word) for word in words.split(", ")] == pytest.approx(force, abs=0.05):
                    return

        assert hear("^connected: (.*)").group(1) == "bartels2026-validation, 4 modules, up y"
        for kind in map(str.capitalize, DEFINITIONS["Effect"]["properties"]["kind"]["enum"]):
            do(f"on {kind} {kind} 0 0.3 0 {SOFT.get(kind, '')}".rstrip(), "state")
            hear("^state: ")
            do(f"off {kind}")
        until(0, 0, 0)
        assert not [line for line in heard if line.startswith(("error", "refused"))]
        # Unity is left-handed: its ahead is the rig's behind, and its up is up.
        do("on floor Wall 0 0.35 0 stiffness 20", "hand 0 0.3 0")
        until(0, 1, 0)
        do("off floor", "on ahead Wall 0 0.3 0.05 stiffness 20", "turn ahead 1 0 0 90")
        until(0, 0, 1)
        do("on bad Wall 0 0.3 0 stiffness -1")
        assert (
            hear("^refused: (.*)")
            .group(1)
            .startswith("effect 'bad': Wall: stiffness is -1.0; give a finite number")
        )
        do("stop")
        hear("^event: ended: ")
        game.kill()
