from types import SimpleNamespace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import HardwareError
from tensionlab.hardware.runner.program import load_program


@pytest.fixture
def rig():
    return tl.load_rig("datasets/rigs/bartels2026-validation.toml")


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "program.toml"
        path.write_text(text)
        return path

    return write


def step(seconds=1.0, wrench=(0.0, 0.0, 1.0), more=""):
    return f"[[steps]]\nseconds = {seconds}\nwrench = {list(wrench)}\n{more}\n"


def at(program, time):
    return program(SimpleNamespace(time=time))


def test_wrenches_are_held_and_gone_to_evenly(rig, write):
    text = (
        'name = "a"\n'
        + step(more="ramp = true")
        + step(2.0, (1.0, 0.0, 1.0))
        + step(1.0, (0, 0, 0), "ramp = true")
    )
    program = load_program(write(text), rig)
    assert program.seconds == 4.0
    np.testing.assert_allclose(at(program, 0.25).wrench, [0.0, 0.0, 0.25])
    np.testing.assert_allclose(at(program, 1.0).wrench, [1.0, 0.0, 1.0])
    np.testing.assert_allclose(at(program, 3.5).wrench, [0.5, 0.0, 0.5])
    assert at(program, 4.0).stop


def test_a_program_that_repeats_goes_on_from_its_end(rig, write):
    text = 'name = "a"\nrepeat = true\n' + step(more="ramp = true") + step(1.0, (2.0, 0.0, 0.0))
    program = load_program(write(text), rig)
    np.testing.assert_allclose(at(program, 0.5).wrench, [0.0, 0.0, 0.5])
    np.testing.assert_allclose(at(program, 2.5).wrench, [1.0, 0.0, 0.5])


def test_brakes_belong_to_a_step(rig, write):
    program = load_program(write('name = "a"\n' + step(more='brakes = ["top"]') + step()), rig)
    assert at(program, 0.5).brakes == {"top"}
    assert not at(program, 1.5).brakes


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "program.toml: 2 problems:\n  name is missing"),
        ('name = "a"\nsteps = []', "program.toml: steps has 0 entries"),
        ('name = "a"\n' + step(0.0), r"program.toml: steps\[0\]\.seconds is 0\.0; give more than 0"),
        ('name = "a"\n' + step("inf"), r"steps\[0\]\.seconds is .*; give a finite number"),
        ('name = "a"\n' + step(wrench=(1.0, 2.0)), "step 1: wrench is .*this rig takes 3 components"),
        ('name = "a"\n' + step() + step(more='brakes = ["to"]'), 'step 2: no module "to"; there are floor-1'),
        ('name = "a"\n' + step(more="rammp = true"), 'rammp is an unknown key; did you mean "ramp"?'),
        ("name = ", "program.toml: not valid TOML"),
    ],
)
def test_files_that_are_no_program_say_why(rig, write, text, message):
    with pytest.raises(HardwareError, match=message):
        load_program(write(text), rig)


def test_a_file_that_is_not_there(rig, tmp_path):
    with pytest.raises(HardwareError, match="no such file; give the path of a program"):
        load_program(tmp_path / "none.toml", rig)
