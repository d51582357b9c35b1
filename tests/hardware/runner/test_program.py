from types import SimpleNamespace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import HardwareError
from tensionlab.hardware.runner.program import load_program


@pytest.fixture
def load(tmp_path):
    rig = tl.load_rig("bartels2026-validation")

    def load(text):
        path = tmp_path / "program.toml"
        path.write_text(text)
        return load_program(path, rig, rate=50.0)

    return load


SINE = 'name = "a"\n[[steps]]\nseconds = 1.0\nwrench = [0, 0, 1]\nsine = {{ amplitude = {}, frequency = {} }}\n'


def step(seconds=1.0, wrench=(0.0, 0.0, 1.0), more=""):
    return f"[[steps]]\nseconds = {seconds}\nwrench = {list(wrench)}\n{more}\n"


@pytest.mark.parametrize(
    ("repeat", "forces"),
    [
        (False, {0.25: [0, 0, 0.25], 1.0: [1, 0, 1], 3.5: [0.5, 0, 0.5], 3.999: [0.001, 0, 0.001], 4.0: None}),
        (True, {0.25: [0, 0, 0.25], 3.5: [0.5, 0, 0.5], 4.25: [0, 0, 0.25], 101.0: [1, 0, 1]}),
    ],
)
def test_wrenches_are_held_or_ramped_to_with_brakes_by_step(load, repeat, forces):
    steps = step(more="ramp = true") + step(2.0, (1.0, 0.0, 1.0), 'brakes = ["top"]')
    steps += step(1.0, (0, 0, 0), "ramp = true")
    program = load(f'name = "a"\nrepeat = {str(repeat).lower()}\n{steps}')
    assert program.seconds == 4.0
    for time, force in forces.items():
        demand = program(SimpleNamespace(time=time))
        assert demand.stop == (force is None)
        assert demand.brakes == ({"top"} if 1.0 <= time % 4.0 < 3.0 else set())
        if force is not None:
            np.testing.assert_allclose(demand.wrench, force, atol=1e-12)


def test_a_repeated_program_ramps_from_its_last_wrench(load):
    program = load('name = "a"\nrepeat = true\n' + step(more="ramp = true") + step(1.0, (2.0, 0.0, 0.0)))
    np.testing.assert_allclose(program(SimpleNamespace(time=2.5)).wrench, [1.0, 0.0, 0.5])


def played(load, oscillation, seconds=4.0):
    """Times (K,) in s, and the force around its mean (K, 3) in N, at 1 kHz."""
    program = load('name = "a"\n' + step(seconds, (0.5, 0.0, 1.0), oscillation))
    time = np.arange(0.0, seconds, 1e-3)
    wrenches = [program(SimpleNamespace(time=each)).wrench for each in time]
    return time, np.array(wrenches) - [0.5, 0.0, 1.0]


def test_a_sine_has_its_amplitude_and_frequency(load):
    _, force = played(load, "sine = { amplitude = [0.0, 0.6, 0.8], frequency = 7.0 }")
    spectrum = 2.0 * np.abs(np.fft.rfft(force @ [0.0, 0.6, 0.8])) / len(force)
    assert spectrum[28] == pytest.approx(1.0)  # 7 Hz in 4 s
    assert np.delete(spectrum, 28).max() < 1e-9
    assert np.abs(force[:, 0]).max() == 0.0


def test_a_circle_turns_in_its_plane_from_its_first_axis_to_its_second(load):
    time, force = played(load, 'circle = { radius = 0.5, plane = "zx", frequency = 0.25 }')
    np.testing.assert_allclose(np.linalg.norm(force, axis=1), 0.5)
    np.testing.assert_allclose(force[[0, 1000]], [[0.0, 0.0, 0.5], [0.5, 0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(np.unwrap(np.arctan2(force[:, 0], force[:, 2])), 0.5 * np.pi * time, atol=1e-9)


@pytest.mark.parametrize(("begin", "end"), [(0.5, 20.0), (20.0, 0.5), (3.0, 3.0)])
def test_a_sweep_passes_as_long_through_every_octave(load, begin, end):
    time, force = played(load, f"sweep = {{ amplitude = [0.0, 0.0, 2.0], begin = {begin}, end = {end} }}", 8.0)
    rises = np.flatnonzero((force[:-1, 2] < 0.0) & (force[1:, 2] >= 0.0))
    part = force[rises, 2] / (force[rises, 2] - force[rises + 1, 2])
    crossings = time[rises] + 1e-3 * part
    middles = (crossings[1:] + crossings[:-1]) / 2
    np.testing.assert_allclose(1.0 / np.diff(crossings), begin * (end / begin) ** (middles / 8.0), rtol=0.03)
    assert np.abs(force).max() == pytest.approx(2.0, rel=1e-2)


def test_an_oscillation_fades_in_where_a_step_is_a_ramp_and_leaves_its_mean_to_the_next(load):
    first = step(1.0, (0.0, 0.0, 0.0), "ramp = true\nsine = { amplitude = [1.0, 0.0, 0.0], frequency = 10.0 }")
    program = load('name = "a"\n' + first + step(1.0, (0.0, 0.0, 1.0), "ramp = true"))
    demands = {time: program(SimpleNamespace(time=time)).wrench for time in (0.025, 0.925, 1.5)}
    np.testing.assert_allclose(list(demands.values()), [[0.025, 0, 0], [0.925, 0, 0], [0, 0, 0.5]], atol=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "program.toml: 2 problems:\n  name is missing"),
        ('name = "a"\nsteps = []', "program.toml: steps has 0 entries"),
        ('name = "a"\n' + step(0.0), r"program.toml: steps\[0\]\.seconds is 0\.0; give more than 0"),
        ('name = "a"\n' + step("inf"), r"steps\[0\]\.seconds is .*; give a finite number"),
        ('name = "a"\n' + step(wrench=(1.0, 2.0)), "step 1: wrench is .*this rig takes 3 components"),
        ('name = "a"\n' + step() + step(more='brakes = ["to"]'), 'step 2: no module "to"; there are floor-1'),
        ('name = "a"\n' + step(more="rammp = true"), "rammp is an unknown key; did you mean 'ramp'?"),
        (SINE.format("[1, 0]", 2.0), r"step 1: amplitude is \[1\.0, 0\.0\]; this rig takes 3 components"),
        (
            SINE.format("[1, 0, 0]", 25.0),
            "step 1: 25 Hz is not below half the rate of the run, 50 Hz",
        ),
        (SINE.format("[1, 0, 0]", 0.0), r"steps\[0\]\.sine\.frequency is 0\.0; give more than 0"),
        (SINE.format("[1, 0, inf]", 2.0), r"sine\.amplitude\[2\] is .*; give a finite number"),
        (
            'name = "a"\n' + step(more='circle = {plane = "xx", radius = 1.0, frequency = 1.0}'),
            "plane is 'xx'; give",
        ),
        ('name = "a"\n' + step(more="sweep = {amplitude = [0, 0, 1], begin = 1.0, end = 30.0}"), "step 1: 30 Hz"),
        ("name = ", "program.toml: not valid TOML"),
    ],
)
def test_files_that_are_no_program_say_why(load, text, message):
    with pytest.raises(HardwareError, match=message):
        load(text)


def test_a_circle_needs_axes_that_the_rig_has(tmp_path):
    path = tmp_path / "program.toml"
    path.write_text(
        'name = "a"\n' + step(wrench=(0, 0, 0), more='circle = {plane = "xz", radius = 1.0, frequency = 1.0}')
    )
    with pytest.raises(HardwareError, match='step 1: plane is "xz"; this rig has the axes x, y'):
        load_program(path, tl.load_rig("kntu-planar"))
