"""Calibration of a module's tension per ampere, friction and zero by weights on its cable.

A cable that is just being reeled in under a weight w needs the current of ``k (I - I0) = w + f``; one that just
begins to pay out, of ``k (I - I0) = w - f``. Half of the difference is the friction f, so k and the zero I0 are
free of it. See Bartels et al. 2026 for the modules; separating friction by the direction of motion is standard in
identifying robots (Armstrong-Hélouvry et al. 1994, Automatica 30(7)).

To measure, the set-point goes up slowly until the cable reels in, and down until it pays out. Force that grows
evenly moves a mass at rest by the cube of time, so the cube root of the way leads back to the moment of its start.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from tensionlab.errors import CalibrationError
from tensionlab.hardware.calibration.pulling import PERIOD_S, Puller, pulling
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import State
from tensionlab.model.module import STANDARD_GRAVITY_M_S2
from tensionlab.support.arrays import Floats

CONFIDENCE = 0.95  # level of all intervals here


@dataclass(frozen=True)
class Estimate:
    """Number with its 95 % confidence interval; NaN where it is not known."""

    value: float
    lower: float
    upper: float

    @property
    def half_width(self) -> float:
        """Half of the interval."""
        return (self.upper - self.lower) / 2.0

    def __contains__(self, value: float) -> bool:
        return self.lower <= value <= self.upper


def around(value: float, deviation: float, freedom: int) -> Estimate:
    """Return the estimate of a value, its standard deviation and degrees of freedom."""
    width = quantile(freedom) * deviation
    return Estimate(value, value - width, value + width)


def quantile(freedom: int) -> float:
    """Return half an interval in standard deviations (Student's t); NaN without a degree of freedom."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, (1.0 + CONFIDENCE) / 2.0)) if freedom > 0 else math.nan


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Linear least-squares fit."""

    coefficients: Floats  # (p,)
    covariance: Floats  # (p, p) by the residuals; NaN without a degree of freedom
    freedom: int  # number of rows minus coefficients
    residuals: Floats  # (k,)


def fit(rows: Floats, values: Floats) -> LinearFit:
    """Fit ``rows @ coefficients = values`` by least squares; rows (k, p) have full column rank."""
    coefficients = np.asarray(np.linalg.lstsq(rows, values, rcond=None)[0], dtype=np.float64)
    residuals = values - rows @ coefficients
    freedom = len(values) - rows.shape[1]
    variance = float(residuals @ residuals) / freedom if freedom > 0 else math.nan
    covariance = np.asarray(variance * np.linalg.inv(rows.T @ rows), dtype=np.float64)
    return LinearFit(coefficients, covariance, freedom, residuals)


@dataclass(frozen=True)
class Balance:
    """Weight at the cable's far end, and the motor current that balances it."""

    force: float  # N
    current: float  # A
    direction: int  # 1 while the cable is being reeled in, -1 while it pays out


@dataclass(frozen=True)
class GainEstimate:
    """Estimate of a module's tension per ampere."""

    gain: Estimate  # N/A
    friction: Estimate  # N at the cable to set it in motion, cogging included
    zero: Estimate | None  # current in A without a tension; None with a single weight, where it is taken to be 0
    previous_gain: float  # N/A of the module until now
    before: float  # rms error of the tension by the currents and the previous gain, in N, friction not counted
    after: float  # the same by the gain and zero found
    balances: tuple[Balance, ...]


def estimate_gain(balances: Sequence[Balance], previous_gain: float) -> GainEstimate:
    """Estimate N/A, friction and zero from the currents that weights needed.

    The weights are known better than the currents, so currents are fitted: ``I = w / k ± f / k + I0``. A
    `CalibrationError` refuses too few balances, only one direction, or currents that do not grow with the weight.
    """
    if min(sum(balance.direction == direction for balance in balances) for direction in (-1, 1)) < 2:
        raise CalibrationError(f"{len(balances)} balances are not enough; measure twice in each direction")
    force, current, direction = np.array(
        [(balance.force, balance.current, balance.direction) for balance in balances]
    ).T
    several = float(np.ptp(force)) > 0.0
    fitted = fit(np.column_stack([force, direction, *([np.ones(len(force))] if several else [])]), current)
    values, deviations = fitted.coefficients.tolist(), np.sqrt(np.diag(fitted.covariance)).tolist()
    slope = around(values[0], deviations[0], fitted.freedom)
    if not slope.lower > 0.0:
        raise CalibrationError("the current does not clearly grow with the weight; take weights that differ more")
    gain = Estimate(1.0 / slope.value, 1.0 / slope.upper, 1.0 / slope.lower)
    gradient = np.array([-values[1] / values[0], 1.0]) / values[0]  # of the friction, by the delta method
    variance = float(gradient @ fitted.covariance[:2, :2] @ gradient)
    friction = around(values[1] / values[0], math.sqrt(variance), fitted.freedom)
    zero = around(values[2], deviations[2], fitted.freedom) if several else None
    tension = force + friction.value * direction
    modelled = previous_gain * current, gain.value * (current - (zero.value if zero else 0.0))
    previous_error, error = (math.sqrt(float(np.mean((estimated - tension) ** 2))) for estimated in modelled)
    return GainEstimate(gain, friction, zero, previous_gain, previous_error, error, tuple(balances))


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


def weigh(
    client: ModuleClient, mass: float, repeats: int = 5, progress: Callable[[float], None] | None = None
) -> list[Balance]:
    """Measure the currents that lift a mass, in kg, and let it down, several times.

    The mass stands or hangs still with its cable straight, and has 5 cm to rise. The module is stopped at the end.
    `progress` is called with the share that is done. A `CalibrationError` if the mass is too light or too heavy
    for the module, or does not come to rest; a `HardwareError` if the module releases it, or does not answer.
    """
    info, weight = client.hello(), mass * STANDARD_GRAVITY_M_S2
    if info.state is not State.IDLE:
        raise client.fault(f"is {info.state.name}, not IDLE; stop it first (after a fault: clear it)", info.state)
    lower = info.tension_lower
    upper = info.tension_continuous
    if not lower < weight < upper:
        lowest, highest = 1.3 * lower / STANDARD_GRAVITY_M_S2, 0.9 * upper / STANDARD_GRAVITY_M_S2
        wrong = f"{mass:g} kg is too {'light' if weight <= lower else 'heavy'}"
        raise CalibrationError(f'module "{client.name}": {wrong}; hang {lowest:.2f} to {highest:.2f} kg on it')
    balances = []
    with pulling(client, info) as puller:
        ramp = partial(_ramp, puller, min(info.tension_upper, MAX_WEIGHT_RATIO * weight))
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
        # The mass is lowered slowly for a second, so that it does not fall when the module stops.
        telemetry = puller.hold(middle)
        for _ in range(round(1.0 / PERIOD_S)):
            middle = max(middle - 4.0 * RAMP_N_S * PERIOD_S, lower)
            telemetry = puller.hold(max(middle + 4.0 * DAMPING_NS_M * telemetry.speed, lower))
    return balances


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
            still = (
                f"at {tension:.2f} N its cable does not {verb}; is the mass {mass}, or not free to move by 5 cm?"
            )
            raise CalibrationError(f'module "{puller.client.name}": {still}')
        telemetry = puller.hold(max(tension + damping * telemetry.speed, info.tension_lower))
        turned = max(turned, direction * telemetry.length)  # it may still be on its way back
    return tension if started is None else started


def _settle(puller: Puller, tension: float) -> None:
    puller.reports.clear()
    telemetry = puller.hold(tension)
    for _ in range(round(REST_TIMEOUT_S / PERIOD_S)):
        telemetry = puller.hold(max(tension + DAMPING_NS_M * telemetry.speed, puller.info.tension_lower))
        first, last = puller.reports[0].time_us, puller.reports[-1].time_us
        if (last - first) % (1 << 32) > 1e6 * STILL_S:
            if np.ptp([report.length for report in puller.reports]) < STILL_M:
                return
            del puller.reports[: len(puller.reports) // 2]
    moving = f"the mass does not come to rest at {tension:.2f} N; does it swing?"
    raise CalibrationError(f'module "{puller.client.name}": {moving}')


def _current_at_start(puller: Puller, direction: int) -> float:
    """Return the current that the module measured when the cable began to move."""
    reports = puller.reports
    time = 1e-6 * np.array([(report.time_us - reports[0].time_us) % (1 << 32) for report in reports])
    current, length = (np.array([getattr(report, name) for report in reports]) for name in ("current", "length"))
    way = direction * (np.median(length[:10]) - length)
    last_still = int(np.flatnonzero(way < STARTED_M)[-1])
    moving = slice(last_still + 1, None)
    if len(way[moving]) < MIN_MOVING_SAMPLES:
        raise CalibrationError(f'module "{puller.client.name}": its cable moved too suddenly; did the mass stick?')
    slope, offset = np.polyfit(time[moving], np.cbrt(way[moving]), 1)
    start = float(np.clip(-offset / slope, time[max(last_still - 50, 0)], time[last_still]))
    near = time > start - TREND_S
    return float(np.polyfit(time[near] - start, current[near], 1)[1])
