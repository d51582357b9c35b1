"""Parameters go to a file and come back whole, or not at all."""

import random
import tomllib

import numpy as np
import pytest

from tensionlab.errors import HardwareError, LinkTimeout, ModuleFault
from tensionlab.hardware.client import parameter_file as settings
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.client.parameter_file import change, dump, parse
from tensionlab.hardware.protocol.codes import BINARY_PARAMETERS, PARAMETERS, Calibration, single
from tensionlab.hardware.simulation.links import SimulatedLink
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule


@pytest.fixture
def client():
    simulated = SimulatedModule(serial_number=7)
    simulated.advance(STEP_S)
    with ModuleClient("one", SimulatedLink(simulated)) as found:
        yield found


def restore(client, text, origin="file"):
    return change(client, parse(text, origin), origin)


def test_a_dump_has_all_parameters_with_units_and_the_module_for_information(client):
    text = dump(client)
    document = tomllib.loads(text)
    assert document["module"] == {"serial_number": 7, "firmware": "0.3"}
    assert list(document["parameters"]) == list(PARAMETERS)
    values = {name: float(np.float32(value)) for name, value in document["parameters"].items()}
    assert values == client.link.module.parameters
    assert "spool_radius = 0.0195             # m, 0.005 to 0.1: from encoder angle to cable length\n" in text
    assert max(map(len, text.splitlines())) < 135


def test_what_was_dumped_comes_back_and_is_not_stored(client):
    text = dump(client)
    assert restore(client, text) == []
    client.set_parameter("slew", 123.25)
    client.set_parameter("ttl", 100.0)
    assert {(each.name, each.before, each.after) for each in restore(client, text)} == {
        ("slew", 123.25, 60.0),
        ("ttl", 100.0, 250.0),
    }
    assert dump(client) == text
    assert client.link.module.settings == b""


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("tension_lower = 1", r"my\.toml: give \[parameters\] with lines"),
        ("[parameters]\n", r"my\.toml: give \[parameters\]"),
        ("[parameters", r"my\.toml: not valid TOML"),
        ("sleuw = 1", r"my\.toml: modules have no parameter \"sleuw\"; is it slew\?"),
        ("ttl = 10", r"my\.toml: ttl is from 50 to 2000 ms; got 10"),
        ("ttl = nan", r"ttl is from 50 to 2000 ms; got nan"),
        ("ttl = 1e60", r"ttl is from .* got 1e\+60"),
        ('ttl = "10"', r"my\.toml: ttl is '10'; give a number"),
        ("calibrated = true", r"calibrated is True; give a number"),
        ("motor_direction = 0", r"motor_direction is 1 or -1; got 0"),
        (
            "tension_upper = 1\ntension_lower = 1.5",
            r'module "one": tension_lower would be 1\.5, but tension_upper 1;',
        ),
        ("length_lower = 5", r"length_lower would be 5, but length_upper 5; change either"),
        (
            "current_continuous = 0.1\ntension_lower = 0.4",
            r"tension_lower would be 0\.4, but current_continuous times newton_per_ampere 0\.3; change either",
        ),
    ],
)
def test_a_file_that_is_wrong_anywhere_changes_nothing(client, text, message):
    before = client.link.module.parameters
    if "[" not in text and text != "tension_lower = 1":
        text = f"[parameters]\nslew = 70\n{text}"
    with pytest.raises(HardwareError, match=message):
        restore(client, text, "my.toml")
    assert client.link.module.parameters == before


def random_values(generator):
    """All parameters, somewhere between their bounds, often at them, and in agreement."""
    while True:
        values = {}
        for name, row in PARAMETERS.items():
            share = generator.choice([0.0, 1.0, generator.random()])
            if name in BINARY_PARAMETERS:
                share = round(share)
            number = float(np.float32(row.lower + share * (row.upper - row.lower)))
            values[name] = min(max(number, row.lower), row.upper)
        try:
            settings._require_consistent(values, "")
        except HardwareError:
            continue
        return values


def test_no_order_of_bounds_that_depend_on_each_other_gets_in_the_way(client):
    generator = random.Random(4)
    for _ in range(200):
        values = random_values(generator)
        change(client, values, "test")
        assert client.link.module.parameters == values


def test_the_host_knows_the_rules_of_the_firmware(client):
    """What the host refuses, the firmware refuses, and the other way round: one value against standard ones."""
    generator = random.Random(5)
    standard = client.link.module.parameters
    for _ in range(300):
        name = generator.choice(list(PARAMETERS))
        row = PARAMETERS[name]
        number = single(generator.choice([row.lower, row.upper, generator.uniform(row.lower, row.upper)]))
        try:
            settings._require_consistent({**standard, name: number}, "")
            allowed = name not in BINARY_PARAMETERS or number in (row.lower, row.upper)
        except HardwareError:
            allowed = False
        try:
            client.set_parameter(name, number)
            taken = True
        except ModuleFault:
            taken = False
        assert taken == allowed, (name, number)
        client.set_parameter(name, standard[name])


def test_a_module_that_is_not_idle_is_left_alone(client):
    text = dump(client)
    client.calibrate(Calibration.NEWTON_PER_AMPERE, 3.0)
    client.arm()
    with pytest.raises(ModuleFault, match=r"refused GetParameter: BAD_STATE \(it is ARMED\)"):
        restore(client, text)


def test_what_was_changed_before_a_link_broke_is_named(client, monkeypatch):
    real = client.command

    def break_off(command, *rest):
        if getattr(command, "value", 0.0) == 123.0:
            raise LinkTimeout("silence")
        real(command, *rest)

    monkeypatch.setattr(client, "command", break_off)
    with pytest.raises(HardwareError, match="silence; until then it took over ttl, and stored nothing"):
        change(client, {"ttl": 100, "slew": 123}, "words")
