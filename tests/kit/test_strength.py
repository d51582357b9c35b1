"""The kit's dimensions are those of the firmware, and its brake bears what it must, as calculated."""

import math
import re
from pathlib import Path

import pytest

from kit import parameters as p
from kit import strength
from tensionlab.hardware.protocol.codes import PARAMETERS
from tensionlab.hardware.simulation.simulated_module import PLANT

TEXT = Path(p.__file__).read_text(encoding="utf-8")


def test_the_spool_is_the_firmwares():
    assert p.spool_radius == pytest.approx(1000 * PARAMETERS["spool_radius"].default)
    assert p.cable_per_tooth == pytest.approx(1000 * PARAMETERS["brake_tooth"].default)
    assert 2 * math.pi * p.spool_radius / p.teeth == pytest.approx(p.cable_per_tooth, rel=0.01)
    assert p.cable_length == pytest.approx(1000 * PARAMETERS["length_upper"].default)
    turns = p.groove_width / p.groove_pitch
    assert turns * 2 * math.pi * p.spool_radius >= p.cable_length
    assert p.groove_pitch > p.cable_diameter
    assert p.highest_tension_n == PARAMETERS["tension_upper"].upper
    assert p.brake_strength_n == PLANT["brake_strength"].default
    assert p.cable_per_tooth == pytest.approx(1000 * PLANT["tooth"].default)


def test_the_brake_bears_its_strength_with_the_stated_factor():
    for load in strength.loads():
        assert load.factor >= p.strength_factor, load
    assert strength.tooth_force() * p.root_radius == pytest.approx(p.brake_strength_n * p.spool_radius)


def test_the_bearings_are_in_balance_with_cable_and_pawl():
    cable = 100.0
    tooth, upper = strength.tooth_force(cable), strength.bearing_load(cable)
    lower = upper - (cable - tooth)  # the other way
    middle = p.motor_base + p.motor_height / 2
    outer = (upper + lower) * p.motor_bearings / 2
    pawl_height = p.motor_top - p.ratchet_width / 2
    assert outer == pytest.approx(cable * (p.cable_height - middle) - tooth * (pawl_height - middle))
    assert strength.bearing_load(strength.breakaway()[1]) < p.brake_strength_n


def test_the_pawl_is_drawn_in_against_friction():
    assert math.tan(math.radians(strength.engagement_angle())) > p.friction


def test_the_link_breaks_between_the_motors_pull_and_the_brakes():
    weakest, strongest = strength.breakaway()
    assert weakest > 2 * p.highest_tension_n
    assert strongest < p.brake_strength_n / 2


def test_every_dimension_says_where_it_comes_from():
    named = re.findall(r"^(\w+)(?:, \w+)* = [^#\n]*(#.*)?$", TEXT.partition("# Heights")[0], re.MULTILINE)
    assert len(named) > 60
    assert [name for name, source in named if not source] == []
    assert sum("measure yours" in source for _, source in named) > 25
