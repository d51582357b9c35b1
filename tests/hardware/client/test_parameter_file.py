"""Parameters go to a file and come back whole, or not at all."""

import random
import tomllib

import numpy as np
import pytest

from tensionlab.errors import HardwareError, LinkTimeout, ModuleFault
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.client.parameter_file import change, dump, parse
from tensionlab.hardware.protocol.codes import BINARY_PARAMETERS, PARAMETERS, Calibration
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
    assert document["module"] == {"serial_number": 7, "firmware": "0.5"}
    assert list(document["parameters"]) == list(PARAMETERS)
    values = {name: float(np.float32(value)) for name, value in document["parameters"].items()}
    assert values == client.link.module.parameters
    assert "spool_radius = 0.0195             # m, 0.005 to 0.1: cable length per encoder angle\n" in text
    assert max(map(len, text.splitlines())) < 135


def test_what_was_dumped_comes_back_and_is_not_stored(client):
    text = dump(client)
    assert restore(client, text) == []
    client.set_parameter("slew", 123.25)
    client.set_parameter("ttl", 100.0)
    changes = {(each.name, each.before, each.after) for each in restore(client, text)}
    assert changes == {("slew", 123.25, 60.0), ("ttl", 100.0, 250.0)}
    assert dump(client) == text
    assert client.link.module.settings == b""


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("tension_lower = 1", r"my\.toml: give \[parameters\] with lines"),
        ("[parameters]\n", r"my\.toml: give \[parameters\]"),
        ("[parameters", r"my\.toml: not valid TOML"),
        ("sleuw = 1", r"my\.toml: modules have no parameter \"sleuw\"; did you mean .slew.\?"),
        ("ttl = 10", r"my\.toml: ttl is from 50 to 2000 ms; got 10"),
        ("ttl = nan", r"ttl is from 50 to 2000 ms; got nan"),
        ("ttl = 1e60", r"ttl is from .* got 1e\+60"),
        ('ttl = "10"', r"my\.toml: ttl is '10'; give a number"),
        ("calibrated = true", r"calibrated is True; give a number"),
        ("motor_direction = 0", r"motor_direction is 1 or -1; got 0"),
        ("tension_upper = 1\ntension_lower = 1.5", r"my\.toml: tension_lower = 1\.5: module \"one\" refused"),
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
    """All parameters, somewhere between their bounds, and often at them."""
    values = {}
    for name, row in PARAMETERS.items():
        share = generator.choice([0.0, 1.0, generator.random()])
        if name in BINARY_PARAMETERS:
            share = round(share)
        number = float(np.float32(row.lower + share * (row.upper - row.lower)))
        values[name] = min(max(number, row.lower), row.upper)
    return values


def agree(values):
    """Whether parameters fit together."""
    hot = 1.5 * values["winding_resistance"] * (1.0 + 0.00393 * (values["winding_limit"] - 20.0))
    resistance = values["winding_to_housing"] + values["housing_to_ambient"]
    square = (values["winding_limit"] - values["ambient"]) / (resistance * hot)
    return (
        values["tension_lower"] <= values["tension_upper"]
        and values["tension_lower"] <= values["newton_per_ampere"] * square**0.5
        and values["length_lower"] < values["length_upper"]
        and values["supply_lower"] < values["supply_upper"]
    )


def test_values_that_fit_together_are_all_taken_over_and_others_not_at_all(client):
    generator, taken = random.Random(4), 0
    for _ in range(600):
        values, before = random_values(generator), client.link.module.parameters
        if agree(values):
            taken += 1
            change(client, values, "test")
            assert client.link.module.parameters == values
        else:
            with pytest.raises(HardwareError, match=r"test: .* refused SetParameter: BAD_VALUE .* fit the other"):
                change(client, values, "test")
            assert client.link.module.parameters == before
    assert taken > 20


def test_a_module_that_is_not_idle_is_left_alone(client):
    text = dump(client)
    client.calibrate(Calibration.NEWTON_PER_AMPERE, 3.0)
    client.arm()
    with pytest.raises(ModuleFault, match=r"refused GetParameter: BAD_STATE \(it is ARMED\)"):
        restore(client, text)


def test_what_was_changed_before_a_link_broke_is_changed_back(client, monkeypatch):
    real = client.command

    def break_off(command, *rest):
        if getattr(command, "value", 0.0) == 123.0:
            raise LinkTimeout("silence")
        real(command, *rest)

    monkeypatch.setattr(client, "command", break_off)
    with pytest.raises(HardwareError, match=r"^words: slew = 123\.0: silence$"):
        change(client, {"ttl": 100, "slew": 123}, "words")
    assert client.parameter("ttl") == 250.0
