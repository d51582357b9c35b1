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
        return load_program(path, rig)

    return load


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
        ("name = ", "program.toml: not valid TOML"),
    ],
)
def test_files_that_are_no_program_say_why(load, text, message):
    with pytest.raises(HardwareError, match=message):
        load(text)
