"""Diagnosis of one module: what is miswired, miscalibrated or missing; ``diagnosis.toml`` has the words.

The firmware's search for the electrical zero tries motor, wires, driver, encoder and current sensing at once.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tensionlab.errors import HardwareError, ModuleFault
from tensionlab.hardware.calibration.pulling import PERIOD_S, TELEMETRY_MS, Puller, pulling
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.client.parameter_file import parameters
from tensionlab.hardware.protocol.codes import PARAMETERS, Calibration, Code, Fault, ResetReason, State
from tensionlab.hardware.protocol.messages import ConfigureTelemetry, Telemetry
from tensionlab.hardware.runner.watchdog import stopping

READING_S, MOMENT_S = 1.0, 0.2  # times for which telemetry is read
SLOW_LOOP_US = 400
JITTER_M = 2e-4  # largest standard deviation of the cable's length at rest
NO_SUPPLY_V, LARGEST_SAG_V = 3.0, 0.5
HAND_M, SLACK_M = 0.005, 0.06  # of cable: it followed a hand; most slack that a pull takes up
POLE_PAIRS = 11  # for which the firmware is compiled
LARGEST_ZERO_ERROR_DEG = 15
PULL_N, RAMP_N_S = 0.5, 1.0  # of the pull: above the minimum tension, and how fast it grows
SLOW_M_S = 0.05  # speed above which it does not grow
PULL_TIMEOUT_S, TTL_MS = 10.0, 150  # of all, and of a set-point
FINDINGS = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
NEXT = "Motor supply on, and the cable's end fixed, with 3 cm of slack: the spool turns to and fro, then pulls"
LEFT_OUT, WRONG = "left out", "left out: first put right what is wrong above"
# Findings with which the electrical zero may be looked for all the same.
BEFORE_SETUP = frozenset({"", "flash-empty", "not-calibrated", "pulses"})


class Check(NamedTuple):
    """Result of a check; `finding` names what is wrong, if anything, and `meaning` says it and what to do."""

    name: str
    result: str
    finding: str = ""
    meaning: str = ""


def diagnose(client: ModuleClient, *, move: bool, ask: Callable[[str], None] | None = None) -> Iterator[Check]:
    """Check a module that no other program uses, step by step, and leave it as it was.

    If it may `move`, its spool turns by up to 20 mm of cable to find the electrical zero, with up to 2 N; then,
    only if nothing was found, it is armed and pulls half a newton more than its minimum tension. `ask` is called
    with what is to be done before a motion, and returns once it is; if left out, no hand pulls the cable. A
    `HardwareError` if the module does not answer, or refuses.
    """
    findings: set[str] = set()

    def note(checks: Iterable[Check]) -> Iterator[Check]:
        for check in checks:
            findings.add(check.finding)
            yield check

    yield from note(_check_state(client))
    if client.state is not State.IDLE:
        return
    yield from note(_check_settings(client))
    yield from note(_check_sensors(client))
    reason = "" if move else LEFT_OUT
    if client.parameter("brake_on_fault"):
        reason = f"{LEFT_OUT}: a load may hang on the cable (`brake_on_fault` is 1)"
    if reason or findings - BEFORE_SETUP:
        yield Check("motion", reason or WRONG)
        return
    if ask is not None:
        yield from note(_check_hand(client, ask))
        ask(NEXT)
    yield from note(_check_zero(client))
    yield Check("pull", WRONG) if findings - {""} else _check_pull(client)


def _judged(name: str, result: str, finding: str = "", **values: object) -> Check:
    """Return a check with its finding, if any, in whose words the values stand."""
    words = "{cause} {advice} (Step {step} of the bring-up.)".format(**FINDINGS[finding]) if finding else ""
    return Check(name, result, finding, words.format(**values))


def _read(client: ModuleClient, seconds: float = MOMENT_S) -> list[Telemetry]:
    reports: list[Telemetry] = []
    client.record(reports)
    client.command(ConfigureTelemetry(TELEMETRY_MS))
    client.wait(seconds)
    client.record(None)
    if not reports:
        raise HardwareError(f'module "{client.name}" sends no telemetry')
    return reports


def _describe(faults: int) -> str:
    return "; ".join(f"{fault.name}: {fault.meaning}" for fault in Fault(faults))


def _check_state(client: ModuleClient) -> Iterator[Check]:
    info = client.hello()
    reason = info.reset_reason
    finding = reason.name.lower() if reason in (ResetReason.WATCHDOG, ResetReason.BROWNOUT) else ""
    yield _judged("start", reason.meaning, finding)
    state = info.state.name.lower()
    finding = {"idle": "", "running": "armed"}.get(state, state)
    meaning = _describe(_read(client)[-1].faults) if info.state is State.FAULT else ""
    yield _judged("state", state, finding, meaning=meaning, url=client.link.url)


def _check_settings(client: ModuleClient) -> Iterator[Check]:
    values = {name: parameter.value for name, parameter in parameters(client).items()}
    finding = "pulses" if values["brake_open_pulse"] == values["brake_closed_pulse"] else ""
    if not values["calibrated"]:
        new = all(math.isclose(value, PARAMETERS[name].default, rel_tol=1e-6) for name, value in values.items())
        finding = "flash-empty" if new else "not-calibrated"
    yield _judged("settings", f"{values['newton_per_ampere']:.3g} N/A", finding, url=client.link.url)


def _check_sensors(client: ModuleClient) -> Iterator[Check]:
    reports = _read(client, READING_S)
    faults = Fault(np.bitwise_or.reduce([report.faults for report in reports]))
    length, supply, loop = np.array(
        [(report.length, report.supply, report.longest_step_us) for report in reports]
    ).T
    jitter = float(np.std(np.diff(length, 2))) / math.sqrt(6.0)  # whatever the spool's speed
    finding = "encoder-noisy" if jitter > JITTER_M else ("" if np.ptp(length) else "encoder-stuck")
    finding = "encoder" if Fault.ENCODER in faults else finding
    yield _judged("encoder", f"jitters by {1e6 * jitter:.2g} um", finding)
    volts, slowest = float(np.median(supply)), float(np.median(loop))
    level = "low" if volts < PARAMETERS["supply_upper"].default else "high"
    wrong = "supply-missing" if volts < NO_SUPPLY_V else f"supply-{level}"
    deaf = "converter" if math.isnan(volts) else ""
    yield _judged("supply", f"{volts:.1f} V", deaf or (wrong if Fault.SUPPLY in faults else ""))
    slow = (slowest > SLOW_LOOP_US or Fault.LOOP in faults) and not deaf  # which makes it slow
    yield _judged("loop", f"{slowest:.0f} us", "loop" if slow else "")
    yield _judged("winding", f"{reports[-1].winding} °C, as estimated")
    others = faults & ~(Fault.ENCODER | Fault.SUPPLY | Fault.LOOP)
    if others and not finding and not deaf:
        yield _judged("faults", str(others.name), "fault", meaning=_describe(others), url=client.link.url)


def _check_hand(client: ModuleClient, ask: Callable[[str], None]) -> Iterator[Check]:
    initial_length = _read(client)[-1].length
    ask("Pull about 5 cm of cable out by hand")
    moved = _read(client)[-1].length - initial_length
    finding = "direction" if moved < -HAND_M else ("not-followed" if moved < HAND_M else "")
    yield _judged("hand", f"{1e3 * moved:+.0f} mm", finding, other=-client.parameter("motor_direction"))


def _check_zero(client: ModuleClient) -> Iterator[Check]:
    """Have the module look for its electrical zero; it keeps the one that it had."""
    previous_zero = zero = client.parameter("motor_zero")
    reports, refusal = _read(client), ""
    volts = float(np.median([report.supply for report in reports]))
    client.logs.clear()
    client.record(reports)
    with stopping(client.stop, client.estop):
        try:
            client.calibrate(Calibration.ENCODER)
            zero = client.parameter("motor_zero")
            client.set_parameter("motor_zero", previous_zero)
        except ModuleFault as refused:
            if refused.code is not Code.FAILED:
                raise
            refusal = (client.logs or [str(refused)])[-1]
    client.record(None)
    measured = [re.findall(r"-?\d+", line) for line in client.logs if "forth" in line]
    forth, back, share = map(int, measured[-1]) if measured else (100, 100, 100)
    error = round(math.remainder(math.degrees(zero - previous_zero), 360.0))
    finding = name_motion(forth, back, share) or ("align" if refusal else "")
    finding = finding or ("zero" if abs(error) > LARGEST_ZERO_ERROR_DEG else "")
    ways = f"turned by {forth} % and {back} % of a pole pair, with {share} % of the current"
    values = {"poles": round(100 * POLE_PAIRS / forth) if forth else 0, "share": share, "degrees": abs(error)}
    yield _judged("zero", ways if refusal else f"off by {error} degrees", finding, why=refusal, **values)
    sag = volts - float(np.percentile([report.supply for report in reports], 5.0))
    yield _judged("load", f"the supply sags by {sag:.1f} V", "supply-weak" if sag > LARGEST_SAG_V else "")


def name_motion(forth: int, back: int, share: int) -> str:
    """Return the finding from the rotor's ways and the currents, in % of what is right; "" if they are."""
    still, even = max(abs(forth), abs(back)) < 20, abs(forth - back) <= 15
    if share < 25:
        return "driver" if still else "amplifiers"
    if not even or abs(abs(forth) - 100) > 15:
        if share < 65:
            return "wire"
        return "held" if still else ("poles" if even and forth > 0 else "pawl")
    if not 75 <= share <= 135:
        return "shunt"
    return "swapped" if forth < 0 else ""


def _check_pull(client: ModuleClient) -> Check:
    """Arm the module, with the lowest minimum tension, and let it take up slack and pull gently."""
    lower = client.parameter("tension_lower")
    client.set_parameter("tension_lower", PARAMETERS["tension_lower"].lower)
    try:
        with pulling(client, client.hello()) as puller:
            return _pull(puller, min(lower + PULL_N, puller.info.tension_upper))
    except HardwareError as error:
        why = _describe(client.endpoint.faults) or str(error)
        return _judged("pull", "released", "late" if client.state is State.TIMEOUT else "pull", why=why)
    finally:
        with suppress(HardwareError):
            (client.clear if client.state is State.FAULT else client.stop)()
            client.set_parameter("tension_lower", lower)


def _pull(puller: Puller, most: float) -> Check:
    start, tension = puller.reports[0].length, puller.info.tension_lower
    for _ in range(round(PULL_TIMEOUT_S / PERIOD_S)):
        latest = puller.hold(tension, TTL_MS)
        moved = f"{1e3 * (latest.length - start):+.0f} mm"
        if abs(latest.length - start) > SLACK_M:
            return _judged("pull", moved, "runaway")
        if tension >= most:
            return _judged("pull", f"{latest.tension:.2g} N with {latest.current:.2g} A, after {moved}")
        slow = abs(latest.speed) < SLOW_M_S
        tension = min(tension + RAMP_N_S * PERIOD_S, most) if slow else puller.info.tension_lower
    return _judged("pull", moved, "pull", why="The cable does not come to rest")
