"""The package for Unity, compiled by Mono with a stub of UnityEngine, at a real bridge; by the wall clock."""

import json
import queue
import re
import shutil
import signal
import subprocess
import threading
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from websockets.sync.client import connect

from tensionlab.model.module import upward
from tests.haptics.bridge.test_real_clients import HANGS_S, RIG, ROOT, served

PACKAGE = ROOT / "examples" / "unity"
STUB = Path(__file__).with_name("unity")
MISSING = [word for word in ("mcs", "mono") if shutil.which(word) is None]
EFFECTS = {
    "Wall": "stiffness 20",
    "Magnetic": "reach 0.2",
    "Textured": "stiffness 20",
    "Shaped": "shape Box",
    "Vibrating": "",
    "Water": "",
    "Friction": "",
    "Weight": "mass 0.05",
    "Recoil": "peak 1",
    "Bow": "",
    "Spring": "stiffness 10",
    "Viscous": "",
}
FORCE = re.compile(r"(desired|measured) \((.*?)\)")
needs_mono = pytest.mark.skipif(bool(MISSING), reason=f"no {' and no '.join(MISSING)} here")


class Game:
    """A scene that is played: commands in, lines out."""

    def __init__(self, running):
        self.running, self.said, self.new = running, [], queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        for line in self.running.stdout:
            self.new.put(line.rstrip())
        self.new.put(None)

    def do(self, *lines):
        for line in lines:
            self.running.stdin.write(line + "\n")
        self.running.stdin.flush()

    def hears(self, pattern):
        """The match of the next line that has a pattern."""
        while True:
            line = self.new.get(timeout=HANGS_S)
            assert line is not None, f"no {pattern!r} in: " + "\n".join(self.said)
            self.said.append(line)
            if found := re.search(pattern, line):
                return found

    def until(self, **forces):
        """Ask for states until forces, in N in Unity's axes, are these within 0.05 N."""
        while True:
            self.do("state")
            line = self.hears("^state: .*").group()
            found = {name: [float(x) for x in words.split(", ")] for name, words in FORCE.findall(line)}
            if all(found[name] == pytest.approx(force, abs=0.05) for name, force in forces.items()):
                return


@pytest.fixture(scope="module")
def player(tmp_path_factory):
    program = tmp_path_factory.mktemp("unity") / "player.exe"
    sources = [*STUB.glob("*.cs"), *PACKAGE.glob("Runtime/**/*.cs"), *PACKAGE.glob("Samples~/**/*.cs")]
    made = subprocess.run(
        ["mcs", "-warnaserror", f"-out:{program}", *map(str, sources)], capture_output=True, text=True, check=False
    )
    assert made.returncode == 0, made.stderr
    return program


@contextmanager
def played(player, url, *words):
    with subprocess.Popen(
        ["mono", str(player), f"{url}/command", *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as running:
        game = Game(running)
        try:
            yield game
        finally:
            running.kill()


@pytest.fixture(scope="module")
def bridge():
    with served() as (url, _):
        yield url


@needs_mono
@pytest.mark.realtime  # a server and a game, each a process
def test_every_effect_is_taken_and_ends(player, bridge):
    with played(player, bridge) as game:
        assert game.hears("^connected: (.*)").group(1) == "bartels2026-validation, 4 modules, up y"
        for kind, words in EFFECTS.items():
            game.do(f"on {kind} {kind} 0 0.3 0 {words}".rstrip(), "state")
            game.hears("^state: ")
            game.do(f"off {kind}")
        game.do("on gun Recoil 0 0.3 0 peak 1", "on bow Bow 0 0.3 0", "state")
        game.hears("^state: ")
        game.do("shoot gun", "release bow", "state")
        game.hears("^state: ")
        game.do("off gun", "off bow")
        game.until(desired=[0, 0, 0])
        assert not [line for line in game.said if line.startswith(("error", "refused"))]
        game.running.stdin.close()
        game.hears("^closed$")


@needs_mono
@pytest.mark.realtime
def test_unity_is_left_handed_and_the_rig_right_handed(player, bridge):
    """Its ahead is the rig's behind; and its origin is where the object of the bridge is."""
    with played(player, bridge, "5", "1", "2") as game, connect(f"{bridge}/state", compression=None) as watch:
        game.hears("^connected")
        game.do("on floor Wall 5 1.35 2 stiffness 20", "hand 5 1.3 2")
        game.until(desired=[0, 1, 0])
        game.do("off floor", "on ahead Wall 5 1.3 2.05 stiffness 20", "turn ahead 1 0 0 90", "hand 5 1.3 2")
        game.until(desired=[0, 0, 1], measured=[0, 0, 1])
        while True:
            said = json.loads(watch.recv(timeout=HANGS_S))
            if said.get("desired") == pytest.approx([0.0, 0.0, -1.0], abs=0.01):
                break
        game.do("off ahead", "turn Rig 0 1 0 90", "on right Wall 4.95 1.3 2 stiffness 20", "turn right 0 0 1 -90")
        game.do("hand 4.9 1.3 2")
        game.until(desired=[1, 0, 0])


@needs_mono
@pytest.mark.realtime
def test_axes_of_either_hand_keep_lengths_and_turns(player):
    """For every axis that may point up; nothing listens at the address."""
    rng = np.random.default_rng(0)
    with played(player, "ws://127.0.0.1:1") as game:
        for up, dimension in [(sign + axis, d) for d in (2, 3) for axis in "xyz"[:d] for sign in ("", "-")]:
            turn = Rotation.random(rng=rng)
            vector = rng.normal(size=3) if dimension == 3 else np.array([*rng.normal(size=2), 0.0])
            for given, wanted in (([0.0, 1.0, 0.0], upward(up, dimension)), (vector, None)):
                game.do(f"axes {up} {dimension} " + " ".join(f"{x:.7f}" for x in [*given, *turn.as_quat()]))
                here, quaternion, turned, back = json.loads(game.hears("^axes: (.*)").group(1))
                np.testing.assert_allclose(back, given, atol=1e-5)
                if wanted is not None:
                    assert here == wanted.tolist()
                elif dimension == 3:
                    np.testing.assert_allclose(Rotation.from_quat(quaternion).apply(here), turned, atol=1e-5)
                    expected = -Rotation.from_quat(quaternion).magnitude() + turn.magnitude()
                    assert expected == pytest.approx(0.0, abs=1e-5)


@needs_mono
@pytest.mark.realtime
def test_what_is_refused_is_told_once_and_left_out(player, bridge):
    with played(player, bridge) as game:
        game.hears("^connected")
        game.do("on floor Wall 0 0.35 0 stiffness 20", "on bad Wall 0 0.3 0 stiffness -1", "hand 0 0.3 0")
        reason = game.hears("^refused: (.*)").group(1)
        assert reason.startswith("effect 'bad': Wall: stiffness is -1.0; give a finite number")
        game.until(desired=[0, 1, 0])
        for _ in range(10):
            game.do("state")
            game.hears("^state: ")
        assert sum(line.startswith("refused") for line in game.said) == 1
        assert "lost" not in game.said


@needs_mono
@pytest.mark.realtime
def test_a_bridge_that_goes_is_found_again_and_stop_ends_the_run(player):
    with served() as (url, running):
        port = url.rsplit(":", 1)[1]
        with played(player, url) as game:
            game.hears("^connected")
            game.do("on floor Wall 0 0.35 0 stiffness 20", "hand 0 0.3 0")
            game.until(desired=[0, 1, 0])
            running.send_signal(signal.SIGKILL)
            running.wait(HANGS_S)
            warning = game.hears("^warning: (.*)").group(1)
            assert warning.startswith(f"the bridge at {url}/command is not there (")
            assert warning.endswith("; looking for it again")
            game.hears("^lost$")
            with served("--port", port, what=(RIG,)) as (again, second):
                assert again == url
                game.hears("^connected: bartels2026-validation")
                game.until(desired=[0, 1, 0])
                game.do("stop")
                game.hears("^event: ended: ")
                game.hears("^lost$")
                assert second.wait(HANGS_S) == 0
            assert sum(line == "lost" for line in game.said) == 2


def test_every_file_of_the_package_has_an_identity_of_its_own():
    """Without one, Unity leaves out what comes by a URL; scenes find scripts by it."""
    found = [path for path in PACKAGE.rglob("*") if path.suffix != ".meta" and path.parent != PACKAGE / "Samples~"]
    found = [path for path in found if path.name != "Samples~"]
    identities = {}
    for path in found:
        text = path.with_name(path.name + ".meta").read_text(encoding="utf-8")
        identities[re.search(r"^guid: ([0-9a-f]{32})$", text, re.MULTILINE).group(1)] = path.name
    assert len(identities) == len(found)
    scene = (PACKAGE / "Samples~/HandAndFloor/HandAndFloor.unity").read_text(encoding="utf-8")
    (script,) = re.findall(r"m_Script: \{fileID: 11500000, guid: (\w+), type: 3\}", scene)
    assert identities[script] == "HandAndFloor.cs"


def test_effects_have_the_parameters_of_the_schema():
    """Each kind has its component, and what that sends is in the schema."""
    kinds = json.loads((ROOT / "examples/bridge/schema.json").read_text(encoding="utf-8"))["$defs"]
    sources = {path.stem: path.read_text(encoding="utf-8") for path in PACKAGE.glob("Runtime/Effects/*Effect.cs")}
    assert set(sources) == {f"{kind}Effect" for kind in EFFECTS} | {"HapticEffect"}
    for kind in EFFECTS:
        keys = set(re.findall(r'parameters\["(\w+)"\]', sources[f"{kind}Effect"]))
        assert keys <= set(kinds[kind.lower()]["properties"])
