"""How are the modules, by the latest that each has said?"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tensionlab.arrays import Floats, Integers
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.protocol.codes import Limit, State


class Observation(NamedTuple):
    """The latest telemetry of all modules; fields as in `RigState`."""

    lengths: Floats
    speeds: Floats
    tensions: Floats
    ages: Floats
    states: Integers
    faults: Integers
    limits: Integers
    brakes: Integers
    taken: Integers
    thermal: Floats


NAN = float("nan")
SILENT = (NAN, NAN, NAN, float("inf"), State.IDLE, 0, Limit.IDLE, -1, -1, NAN)
"""What is known of a module that has said nothing yet."""


def observe(group: ModuleGroup) -> Observation:
    """Read what has come by now."""
    rows: list[tuple[float, ...]] = []
    for client in group.clients:
        client.listen()
        heard = client.telemetry
        if heard is None:
            rows.append(SILENT)
            continue
        said = heard.message
        age = client.link.clock() - heard.time
        state = said.state if client.state is None else client.state
        codes = (state, client.faults, said.limit, said.brake, said.sequence)
        rows.append((said.length, said.speed, said.tension, age, *codes, said.thermal))
    lengths, speeds, tensions, ages, *numbers, thermal = np.array(rows).T
    states, faults, limits, brakes, taken = np.array(numbers, dtype=np.int64)
    return Observation(lengths, speeds, tensions, ages, states, faults, limits, brakes, taken, thermal)
