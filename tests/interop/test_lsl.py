"""Streams of runs, received by real inlets over the network of this machine."""

import itertools
import shutil
import signal
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from benchmarks.processes import process
from tensionlab.cli import main
from tensionlab.demand import Demand, Pose
from tensionlab.hardware import RunLog, Runner, RunSettings, World, WorldClock, read_run
from tensionlab.scenarios import load_scenario
from tensionlab.scenarios.scenario import FOLDER
from tensionlab.support.provenance import manifest
from tests.helpers import runs

pylsl = pytest.importorskip("pylsl")

from tensionlab.lsl import LslStreams  # noqa: E402 - needs pylsl

HANGS_S = 60.0  # only what hangs takes so long
PULL = Demand(np.array([0.0, 0.5, 0.0]), desired=np.array([0.0, 0.7, 0.0]))


def inlet(name):
    """Open the stream of a name, and wait until samples come through."""
    found = pylsl.resolve_byprop("name", name, timeout=HANGS_S)
    assert len(found) == 1, f"{len(found)} streams called {name}"
    opened = pylsl.StreamInlet(found[0])
    opened.open_stream(timeout=HANGS_S)
    return opened


def samples(opened, count):
    """A number of samples, and their time stamps."""
    taken = [opened.pull_sample(timeout=HANGS_S) for _ in range(count)]
    assert all(sample is not None for sample, _ in taken)
    return [sample for sample, _ in taken], np.array([stamp for _, stamp in taken])


def described(opened, key):
    """What the description of a stream says of its channels."""
    channel = opened.info(timeout=HANGS_S).desc().child("channels").child("channel")
    found = []
    while not channel.empty():
        found.append(channel.child_value(key))
        channel = channel.next_sibling()
    return found


@pytest.mark.realtime  # over the network, by the clock of LSL
def test_inlets_get_every_cycle_and_every_event(tmp_path):
    rig = tl.load_rig("floor-3")
    settings, links = RunSettings(rate=50.0), {module.name: "sim:" for module in rig.modules}
    log = RunLog(tmp_path / "run.mcap", rig, manifest(["test"]), "newton", settings, links)
    streams = LslStreams(rig, "newton", 50.0)
    streamed = ("forces", "tensions", "pose", "markers")
    forces, tensions, pose, markers = (inlet(f"floor-3 {what}") for what in streamed)
    assert described(forces, "label")[::3] == ["desired Fx", "commanded Fx", "measured Fx"]
    assert described(tensions, "unit") == ["N"] * (2 * rig.m)
    assert described(pose, "type") == ["PositionX", "PositionY", "PositionZ"]
    world = World(rig)
    clock, sinks = WorldClock(world, paced=True), [log, streams]
    runner = Runner(rig, world.group(), "newton", lambda state: PULL, settings, sinks=sinks, clock=clock)
    before = pylsl.local_clock()
    runner.run(seconds=1.0)
    after = pylsl.local_clock()
    run = read_run(tmp_path / "run.mcap")
    count = len(run.time)
    force, stamps = samples(forces, count)
    force = np.array(force)
    np.testing.assert_array_equal(force[:, :3], run.desired)
    np.testing.assert_array_equal(force[:, :3], np.tile([0.0, 0.7, 0.0], (count, 1)))
    np.testing.assert_allclose(force[:, 6:], np.einsum("cnm,cm->cn", run.structure, run.measured), atol=1e-12)
    tension, _ = samples(tensions, count)
    np.testing.assert_array_equal(np.array(tension)[:, rig.m :], run.measured)
    place, _ = samples(pose, count)
    np.testing.assert_array_equal(place, run.position)
    assert ((before < stamps) & (stamps < after)).all()
    # Both are the start of the cycle, on two clocks; but for cycles that this machine interrupted between the two.
    offset = stamps - run.time
    assert np.ptp(np.quantile(offset, [0.1, 0.9])) < 1.0 / 50.0
    texts, times = samples(markers, 1 + len(run.events))
    texts_of_events = [event.text for event in run.events]
    assert texts[0] == ["begins: floor-3"]
    assert [text for (text,) in texts[1:]] == [f"{event.kind}: {event.text}" for event in run.events]
    assert texts_of_events[-1] == "duration reached"
    assert (np.diff(times) >= 0).all()


@pytest.mark.parametrize(
    ("name", "place", "torques"),
    [("floor-3", [0.1, 0.2, 0.3], ""), ("kntu-planar", [0.1, 0.2, 0.5], "z"), ("cogiro", None, "xyz")],
)
def test_channels_suit_what_the_rig_moves(name, place, torques, monkeypatch):
    rig, sent = tl.load_rig(name), []
    streams = LslStreams(rig, "newton", 50.0)
    monkeypatch.setattr(streams, "_send", lambda outlet, sample, when: sent.append((outlet, list(sample), when)))
    turn = Rotation.from_euler("z", 0.5).as_matrix()
    rotation = None if not torques else 0.5 if rig.dimension == 2 else turn
    position = np.array([0.1, 0.2, 0.3])[: rig.dimension]
    state = replace(next(runs.cycles(runs.four(), 1)).state, pose=Pose(position, rotation))
    structure, tensions = rig.structure_matrix(rig.home, frames=rig.at_rest), np.ones(rig.m)
    changed = {"structure": structure, "tensions": tensions, "active": np.full(rig.m, True)}
    first = replace(next(runs.cycles(runs.four(), 1)), state=replace(state, **changed), commanded=tensions)
    began = pylsl.local_clock()
    streams.write(replace(first, compute_time=0.25))
    counts = [3 * rig.n, 2 * rig.m, 7 if name == "cogiro" else 3]
    assert [outlet.get_info().channel_count() for outlet, *_ in sent] == counts
    assert [len(sample) for _, sample, _ in sent[1:]] == counts[1:]  # the demand is of a point
    np.testing.assert_allclose(sent[2][1], place or [*position, *Rotation.from_matrix(turn).as_quat()])
    assert {when - began + 0.25 < 0.2 for *_, when in sent} == {True}
    assert streams._markers.get_info().channel_format() == pylsl.cf_string
    streams.close(None)


@pytest.mark.realtime  # over the network
def test_what_turns_has_an_orientation():
    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    arms = corners * [0.1, 0.2, -0.1]
    modules = [tl.Module(str(i), corners[i], 0.5, 6.0, arms[i], spool_radius=0.02) for i in range(8)]
    rig = tl.Rig("cube", "platform", tuple(modules), np.zeros(3))
    streams = LslStreams(rig, "newton", 50.0)
    pose = inlet(f"{rig.name} pose")
    assert described(pose, "label")[3:] == ["OrientationX", "OrientationY", "OrientationZ", "OrientationW"]
    world = World(rig)
    runner = Runner(rig, world.group(), "newton", lambda state: Demand(), sinks=[streams], clock=WorldClock(world))
    runner.run(seconds=0.1)
    (place,), _ = samples(pose, 1)
    np.testing.assert_allclose(place[:3], rig.home, atol=1e-3)
    np.testing.assert_allclose(Rotation.from_quat(place[3:]).as_matrix(), np.eye(3), atol=1e-2)


def test_an_error_of_the_network_does_not_reach_the_run(monkeypatch):
    def broken(*_):
        raise RuntimeError("the network is gone")

    monkeypatch.setattr(pylsl.StreamOutlet, "push_sample", broken)
    rig = tl.load_rig("floor-3")
    world, streams = World(rig), LslStreams(rig, "newton", 50.0)
    runner = Runner(rig, world.group(), "newton", lambda state: Demand(), sinks=[streams], clock=WorldClock(world))
    assert runner.run(seconds=0.2).cycles == 10
    assert streams.error == "RuntimeError: the network is gone"


def test_phases_of_a_scenario_are_markers_in_order(tmp_path):
    known, path = FOLDER / "materials.toml", tmp_path / "seconds.toml"
    phase = """[[phases]]
        name = "{0}"
        begin = {0}.0
        end = {0}.9
        effects.of{0} = {{ kind = "magnetic", plane = {{ point = [0.0, 0.0, 1.0] }} }}
    """
    path.write_text(known.read_text().partition("[[phases]]")[0] + "".join(map(phase.format, range(15))))
    shutil.copy(known.with_suffix(".rig.toml"), path.with_suffix(".rig.toml"))
    numbers = []
    with process("scenario", path, "--lsl") as running:
        markers = inlet(f"{load_scenario(path).rig.name} markers")  # on a busy machine it misses the first ones
        while not (text := markers.pull_sample(timeout=HANGS_S)[0][0]).startswith("ended"):
            if text.startswith("phase"):
                numbers.append(int(text.removeprefix("phase: ")))
                if len(numbers) == 2:
                    running.send_signal(signal.SIGTERM)
        assert running.wait(HANGS_S) in (0, 1)  # 1 where a person would notice how late a busy machine is
        assert "Traceback" not in running.stderr.read()
    assert text == "ended: signal SIGTERM"
    first, second = numbers[:2]
    assert second == first + 1


@pytest.mark.parametrize("verb", [("run", "floor-3"), ("serve", "floor-3"), ("scenario", "materials")])
def test_without_pylsl_nothing_begins(verb, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pylsl", None)
    with pytest.raises(SystemExit) as left:
        main([*verb, "--lsl", "--seconds", "1"])
    assert left.value.code == 2
    said = capsys.readouterr().err
    assert 'pip install "tensionlab[lsl]"' in said
    assert "Traceback" not in said
