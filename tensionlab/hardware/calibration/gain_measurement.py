"""Measurement of forces and currents of a module: a mass lifted and let down, or a staircase at a force sensor.

Weighing: the set-point goes up slowly until the cable reels in, and down until it pays out. Force that grows
evenly moves a mass at rest by the cube of time, so the cube root of the way leads back to the moment of its start.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from tensionlab.errors import CalibrationError, HardwareError, ModuleFault
from tensionlab.hardware.calibration.gain import Balance
from tensionlab.hardware.client.module import PATIENT_TIMEOUTS_S, ModuleClient, Received
from tensionlab.hardware.protocol.codes import PARAMETERS, Calibration, Limit, State
from tensionlab.hardware.protocol.messages import ConfigureTelemetry, Info, Message, SetParameter, Telemetry
from tensionlab.hardware.runner.watchdog import stopping
from tensionlab.model.module import STANDARD_GRAVITY_M_S2
from tensionlab.support.arrays import Floats
from tensionlab.support.files.tables import read_table

PERIOD_S = 0.02  # from one set-point to the next, in s
TELEMETRY_MS = 10
MAX_SILENT_PERIODS = 25  # without telemetry
ARM_TRIES = 3
LIMITER_ADVICE = {
    Limit.THERMAL: "its winding's budget is spent; let it cool, and pull less",
    Limit.SPEED: "its cable reels in too fast; is there nothing on it?",
    Limit.LENGTH: "its cable is as short or as long as it may be; move the module, or calibrate its length",
}  # limiters that keep a module from the commanded tension, and what to do about them
# Rate of the set-point in N/s: first to find where the mass moves, then to weigh it.
SEARCH_N_S, RAMP_N_S = 0.5, 0.1
# Cable lengths in m: lifted off the ground; surely moving; moving by more than a tooth of cogging.
LIFT_M, MOVED_M, STARTED_M = 0.01, 0.003, 0.0005
MAX_WEIGHT_RATIO = 2.0  # largest ratio of the set-point to the weight: no N/A is farther off
DAMPING_NS_M = 1.0  # damping of a mass by the host, in N·s/m
STILL_M, STILL_S = 0.0003, 0.2  # a mass that moves no further in this time is at rest
REST_TIMEOUT_S = 5.0  # longest time for a mass to come to rest
MIN_MOVING_SAMPLES = 4  # number of telemetry samples of a moving cable to find its start
TREND_S = 0.5  # time before the start over which the current is fitted


class Puller:
    """Armed module, its description, and its telemetry since it was armed or `reports` was cleared."""

    def __init__(self, client: ModuleClient, info: Info) -> None:
        self.client = client
        self.info = info
        self.reports: list[Telemetry] = []

    def take(self, received: Received[Message]) -> None:
        """Store telemetry."""
        if isinstance(received.message, Telemetry):
            self.reports.append(received.message)

    def hold(self, tension: float) -> Telemetry:
        """Pull with a tension for a period, and return the telemetry at its end; refuse a module that cannot."""
        for _ in range(MAX_SILENT_PERIODS):
            self.client.set_tension(tension)
            self.client.wait(PERIOD_S)
            self.client.check()
            if self.reports:
                break
        else:
            raise HardwareError(f'module "{self.client.name}" sends no telemetry')
        latest = self.reports[-1]
        if latest.limit in LIMITER_ADVICE:
            raise HardwareError(
                f'module "{self.client.name}" does not pull with {tension:.2f} N: {LIMITER_ADVICE[latest.limit]}'
            )
        return latest


@contextmanager
def pulling(client: ModuleClient) -> Iterator[Puller]:
    """Arm a module, and stop it at the end, also after an error.

    A module whose N/A was never calibrated refuses to be armed; meanwhile it is marked as calibrated. A
    `HardwareError` if that could not be undone.
    """
    info = client.hello()
    if info.state is not State.IDLE:
        raise ModuleFault(
            f'module "{client.name}" is {info.state.name}, not IDLE; stop it first (after a fault: clear it)',
            client.name,
            info.state,
        )
    puller = Puller(client, info)
    before, client.on_message = client.on_message, puller.take
    try:
        if not info.calibrated:
            client.calibrate(Calibration.NEWTON_PER_AMPERE, info.newton_per_ampere)
        with stopping(client.stop, client.estop):
            client.command(ConfigureTelemetry(TELEMETRY_MS))
            _arm(client, info.tension_lower)
            yield puller
    finally:
        ended = sys.exception()
        client.on_message = before
        with suppress(HardwareError):
            client.command(ConfigureTelemetry(0))
            client.wait(0.3)  # until nothing pulls any more
        if not info.calibrated:  # it is to refuse to be armed again
            try:
                client.command(SetParameter(PARAMETERS["calibrated"].index, 0.0), PATIENT_TIMEOUTS_S)
            except HardwareError as error:
                armable = (
                    f'module "{client.name}" counts as calibrated though its N/A was never measured, and can be '
                    f"armed: switch it off and on before anything else ({error})"
                )
                if ended is None:
                    raise HardwareError(armable) from None
                ended.args = (f"{ended}. And {armable}",)


def _arm(client: ModuleClient, tension: float) -> None:
    """Arm a module, several times if answers are lost and it times out before the next one comes."""
    for _ in range(ARM_TRIES):
        client.arm()
        client.set_tension(tension)
        client.wait(0.1)
        if client.state is not State.TIMEOUT:
            return
        client.stop()


def weigh(
    client: ModuleClient, mass: float, repeats: int = 5, progress: Callable[[float], None] | None = None
) -> list[Balance]:
    """Measure the currents that lift a mass, in kg, and let it down, several times.

    The mass stands or hangs still with its cable straight, and has 5 cm to rise. The module is stopped at the end.
    `progress` is called with the share that is done. A `CalibrationError` if the mass is too light or too heavy
    for the module, or does not come to rest; a `HardwareError` if the module releases it, or does not answer.
    """
    weight = mass * STANDARD_GRAVITY_M_S2
    _require_weight(client, mass)
    balances = []
    with pulling(client) as puller:
        lower = puller.info.tension_lower
        ramp = partial(_ramp, puller, min(puller.info.tension_upper, MAX_WEIGHT_RATIO * weight))
        _settle(puller, lower)  # takes up slack
        ground = puller.reports[-1].length
        lifted = ramp(lower, SEARCH_N_S, LIFT_M, DAMPING_NS_M)
        lowered = ramp(lifted, -SEARCH_N_S, MOVED_M, DAMPING_NS_M)
        _settle(puller, (lifted + lowered) / 2.0)
        # Once more: the first time, the cable also stretched.
        lifted = ramp((lifted + lowered) / 2.0, SEARCH_N_S, LIFT_M, DAMPING_NS_M)
        middle = (lifted + lowered) / 2.0
        for turn in range(repeats):
            for direction in (-1, 1):
                _settle(puller, middle)
                if puller.reports[-1].length > ground - 2.0 * MOVED_M:
                    ramp(middle, SEARCH_N_S, LIFT_M, DAMPING_NS_M)
                    _settle(puller, middle)
                ramp(middle, direction * RAMP_N_S, MOVED_M)
                balances.append(Balance(weight, _current_at_start(puller, direction), direction))
                if progress:
                    progress((2 * turn + (direction + 3) / 2) / (2 * repeats))
        _settle(puller, middle)
        _let_down(puller, middle)
    return balances


def _require_weight(client: ModuleClient, mass: float) -> None:
    """Refuse a mass that the module can surely not hold."""
    info = client.hello()
    weight = mass * STANDARD_GRAVITY_M_S2
    most = min(info.tension_upper, client.parameter("current_continuous") * info.newton_per_ampere)
    if not info.tension_lower < weight < most:
        lower, upper = info.tension_lower / STANDARD_GRAVITY_M_S2, most / STANDARD_GRAVITY_M_S2
        raise CalibrationError(
            f'module "{client.name}" can pull continuously with {info.tension_lower:.2g} to {most:.2g} N, so '
            f"{mass:g} kg is too {'light' if weight <= info.tension_lower else 'heavy'}: hang a mass of "
            f"{1.3 * lower:.2f} to {0.9 * upper:.2f} kg on it"
        )


def _ramp(puller: Puller, most: float, tension: float, rate: float, way: float, damping: float = 0.0) -> float:
    """Change the set-point, up to `most`, until the cable has moved so far; return that at which it started."""
    info, direction = puller.info, 1.0 if rate > 0.0 else -1.0
    puller.reports.clear()
    telemetry = puller.hold(tension)
    started, turned = None, direction * telemetry.length
    while (moved := turned - direction * telemetry.length) < way:
        if started is None and moved > STARTED_M:
            started = tension
        tension += rate * PERIOD_S
        if not info.tension_lower <= tension <= most:
            verb, mass = ("reel in", "heavier") if rate > 0.0 else ("pay out", "lighter")
            raise CalibrationError(
                f'module "{puller.client.name}": at {tension:.2f} N its cable does not {verb} yet; is the mass '
                f"{mass} than was said, or not free to move by 5 cm?"
            )
        telemetry = puller.hold(max(tension + damping * telemetry.speed, info.tension_lower))
        turned = max(turned, direction * telemetry.length)  # it may still be on its way back
    return tension if started is None else started


def _settle(puller: Puller, tension: float) -> None:
    """Hold the mass, with damping, until it is at rest."""
    puller.reports.clear()
    telemetry = puller.hold(tension)
    for _ in range(round(REST_TIMEOUT_S / PERIOD_S)):
        telemetry = puller.hold(max(tension + DAMPING_NS_M * telemetry.speed, puller.info.tension_lower))
        first, last = puller.reports[0].time_us, puller.reports[-1].time_us
        if (last - first) % (1 << 32) > 1e6 * STILL_S:
            if np.ptp([each.length for each in puller.reports]) < STILL_M:
                return
            del puller.reports[: len(puller.reports) // 2]
    raise CalibrationError(
        f'module "{puller.client.name}": the mass does not come to rest at {tension:.2f} N; does it swing, or is '
        "there hardly any friction?"
    )


def _let_down(puller: Puller, tension: float) -> None:
    """Lower the mass for a second, slowly, so that it does not fall when the module stops."""
    telemetry = puller.hold(tension)
    for _ in range(round(1.0 / PERIOD_S)):
        tension = max(tension - 4.0 * RAMP_N_S * PERIOD_S, puller.info.tension_lower)
        telemetry = puller.hold(max(tension + 4.0 * DAMPING_NS_M * telemetry.speed, puller.info.tension_lower))


def _current_at_start(puller: Puller, direction: int) -> float:
    """Return the current that the module measured when the cable began to move."""
    reports = puller.reports
    time = 1e-6 * np.array([(each.time_us - reports[0].time_us) % (1 << 32) for each in reports])
    current, length = (np.array([getattr(each, name) for each in reports]) for name in ("current", "length"))
    way = direction * (np.median(length[:10]) - length)
    last_still = int(np.flatnonzero(way < STARTED_M)[-1])
    moving = slice(last_still + 1, None)
    if len(way[moving]) < MIN_MOVING_SAMPLES:
        raise CalibrationError(
            f'module "{puller.client.name}": its cable moved too suddenly; has the mass come off, did it stick?'
        )
    slope, offset = np.polyfit(time[moving], np.cbrt(way[moving]), 1)
    start = float(np.clip(-offset / slope, time[max(last_still - 50, 0)], time[last_still]))
    near = time > start - TREND_S
    trend = np.polyfit(time[near] - start, current[near], 1)
    return float(trend[1])


LEVELS = 8
DWELL_S = 1.5  # duration of each step; its second half counts
RATE_N_S = 1.0  # from step to step: slow, so that the cable does not ring over its friction
MAX_SHARE = 0.9  # highest step, as a share of the winding's continuous rating
LAG_STEP_S = 0.02  # spacing of the lags that are tried
MIN_CORRELATION = 0.95  # least correlation of force and current for the two to be the same staircase


@dataclass(frozen=True, eq=False)
class Staircase:
    """Measurements of a module during a staircase of tensions, in columns (K,)."""

    time: Floats  # of the host, in s since the start
    current: Floats  # in A
    tension: Floats  # of the motor, by the module, in N
    step: Floats  # number of the step, from 0; -1 on the way between two
    direction: Floats  # 1 where it was reached from below, -1 from above


COLUMNS = tuple(Staircase.__dataclass_fields__)


def load_staircase(path: str | Path) -> Staircase:
    """Return a saved staircase; a `CalibrationError` says what is wrong with the file."""
    return Staircase(**read_table(path, COLUMNS, error=CalibrationError))


def load_sensor(path: str | Path) -> tuple[Floats, Floats]:
    """Return times in s and forces in N of a file with columns ``time``, ``force``; pulling is positive."""
    table = read_table(path, ("time", "force"), error=CalibrationError)
    if len(table["time"]) < 10 or (np.diff(table["time"]) <= 0.0).any():
        raise CalibrationError(f"{path}: times must grow from line to line, over at least 10 lines")
    return table["time"], table["force"]


def climb(client: ModuleClient, progress: Callable[[float], None] | None = None) -> Staircase:
    """Measure the currents of a staircase of tensions, up and down.

    The cable is tied to a force sensor that does not move. The module is stopped at the end, also after an error.
    """
    rows: list[tuple[float, ...]] = []
    most = client.parameter("current_continuous") * client.hello().newton_per_ampere
    with pulling(client) as puller:
        info = puller.info
        levels = np.linspace(info.tension_lower, MAX_SHARE * min(info.tension_upper, most), LEVELS)
        way = [*levels, *levels[-2::-1]]
        start, tension = client.link.clock(), float(levels[0])

        def hold(step: int, direction: int) -> None:
            telemetry = puller.hold(tension)
            rows.append((client.link.clock() - start, telemetry.current, telemetry.tension, step, direction))

        for step, level in enumerate(way):
            direction = 1 if step < LEVELS else -1
            while abs(level - tension) > 1e-9:
                tension += float(np.clip(level - tension, -RATE_N_S * PERIOD_S, RATE_N_S * PERIOD_S))
                hold(-1, direction)
            for _ in range(round(DWELL_S / PERIOD_S)):
                hold(step, direction)
            if progress:
                progress((step + 1) / len(way))
    return Staircase(*np.array(rows, dtype=np.float64).T)


def lag(record: Staircase, time: Floats, force: Floats) -> float:
    """Return the lead of the sensor's clock over the host's, in s, at which force and current agree best."""
    spare = 0.2 * (record.time[-1] - record.time[0])
    lags = np.arange(time[0] - record.time[0] - spare, time[-1] - record.time[-1] + spare, LAG_STEP_S)
    sensed = [np.interp(record.time + each, time, force) for each in lags]
    agreement = [float(np.corrcoef(record.current, each)[0, 1]) if np.ptp(each) else -1.0 for each in sensed]
    if not agreement or max(agreement) < MIN_CORRELATION:
        best = f"agree by {max(agreement):.2f} at best" if agreement else "do not overlap"
        raise CalibrationError(
            f"the sensor's force and the module's current {best}; were they recorded together, in s and N, "
            "with the cable tight? Give the lag yourself if the clocks are known"
        )
    return float(lags[int(np.argmax(agreement))])


def balances(record: Staircase, time: Floats, force: Floats, ahead: float) -> list[Balance]:
    """Return the force and current of each step but the first; a `CalibrationError` names one without a force."""
    found = []
    for step in np.unique(record.step[record.step > 0]):
        on = np.flatnonzero(record.step == step)
        late = on[len(on) // 2 :]
        start, end = record.time[late[0]] + ahead, record.time[late[-1]] + ahead
        within = (time >= start) & (time <= end)
        if not within.any():
            raise CalibrationError(
                f"the sensor recorded nothing from {start:.2f} to {end:.2f} s, which is step {step:.0f}; start it "
                "before the staircase, and stop it after"
            )
        means = float(force[within].mean()), float(record.current[late].mean())
        found.append(Balance(*means, int(record.direction[late[0]])))
    return found
