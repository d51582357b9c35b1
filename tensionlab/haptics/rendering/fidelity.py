"""Fidelity of rendered forces: desired against measured, in the numbers by which a person judges them.

Just noticeable differences (JND): of a force, 7 % from 2.5 N on (Pang, Tan and Durlach 1991, "Manual
discrimination of force using active finger motion") and 10 % below (Allin, Matsuoka and Klatzky 2002, "Measuring
just noticeable differences for haptic force feedback"); of a stiffness, 23 % (Jones and Hunter 1990, "A perceptual
analysis of stiffness"). A direction convinces within 45 degrees. All other bounds are choices of this project.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensionlab.haptics.effects.effect import norm, normalized
from tensionlab.support.arrays import Floats, angles

STRONG_FORCE_N, STRONG_JND, WEAK_JND = 2.5, 0.07, 0.10
MIN_JND_N = 0.05  # forces are discriminated no better than this
STIFFNESS_JND = 0.23
MIN_FORCE_N = 0.5  # weaker forces have no direction; a stronger one where none is desired is a failure
MAX_ANGLE_DEG = 45.0
MAX_ERROR_JND = 4.0  # largest root mean square error, in JNDs: 28 % of a strong force, 40 % of a weak one
MIN_AMPLITUDE = 10.0 ** (-3.0 / 20.0)  # share of an amplitude that is left at the end of the bandwidth, 3 dB down
MIN_COHERENCE, MIN_EXCITATION = 0.8, 1e-3  # of frequencies that count for the bandwidth; share of the strongest
MIN_OSCILLATION_HZ = 4.0  # slower changes may be the hand's own will
# Window of an oscillation, windows in a row that it lasts, and share of what is above 4 Hz that is in its line.
OSCILLATION_S, LASTING, NARROW = 0.64, 3, 0.5
OWN_SHARE = 0.25  # an oscillation whose error is a smaller share of it is desired
MIN_FIT = 0.8  # smallest share of the variance that a spring and a damper explain
MIN_SHARES = (0.3, 0.05)  # of stiffness and damping in the changes of a force, else it has none
HELD_S = 0.05  # forces where none is desired count if they last this long
VIBRATION_S = 0.25  # window in which a vibration has one phase
STEADY = 0.5  # least share of a vibration's mean amplitude in it: one that fades cannot be told from a release
MAX_LATENCY_S = 0.25
NAN = math.nan
Parts = list[NDArray[np.intp]]  # samples between gaps


def just_noticeable(force: float) -> float:
    """Return the just noticeable difference of a force, in N."""
    return max((STRONG_JND if force >= STRONG_FORCE_N else WEAK_JND) * force, MIN_JND_N)


@dataclass(frozen=True)
class Fidelity:
    """Fidelity of an effect over the time in which it was active; NaN where the motion did not show a number."""

    force: float
    force_rendered: float
    """Desired force, root mean square where it is desired, and the part of it that came, in N."""
    stiffness_desired: float
    stiffness: float
    """Desired and rendered stiffness along the force, in N/m."""
    damping_desired: float
    damping: float
    """Desired and rendered damping, in N s/m; late stiffness is negative damping."""
    amplitude_desired: float
    amplitude: float
    """Desired and rendered amplitude of a vibration, in N; NaN if it fades, or is too fast for the record."""
    bandwidth: float
    """Frequency up to which amplitudes stay within 3 dB, in Hz."""
    excited: float
    """Highest frequency that the motion excited, in Hz: a bandwidth up to there may be larger."""
    error: float
    """Root mean square of measured minus desired force, in N."""
    error_peak: float
    error_jnd: float
    """The same in just noticeable differences of the desired force."""
    direction: float
    """Mean angle between desired and measured force, weighted by the desired, in degrees."""
    free_force: float
    """Largest force where none is desired, in N."""
    oscillation: float
    """Amplitude of an oscillation that is not desired, in N; 0 without one."""
    oscillation_frequency: float
    latency: float
    """Time by which the measured force is late, in s."""
    share_low: float
    share_high: float
    """Share of a softened parameter that was rendered, in the 10th and the 90th of 100 cycles."""
    infeasible: bool = False
    """Whether all failures are because forces were proved infeasible."""

    @property
    def passed(self) -> bool | None:
        """Whether a person would notice nothing; None if only infeasible force is missing."""
        return not self.failures() or (None if self.infeasible else False)

    def numbers(self) -> dict[str, float]:
        """Return the known numbers by name."""
        return {name: value for name, value in vars(self).items() if math.isfinite(value) and name != "infeasible"}

    def summary(self) -> dict[str, Any]:
        """Return the known numbers, with ``passed`` and ``failures``."""
        return self.numbers() | {"passed": self.passed, "failures": self.failures()}

    def failures(self) -> tuple[str, ...]:
        """Return the deviations that a person would notice, in words with numbers."""
        stiffness, amplitude, hertz = self.stiffness_desired, self.amplitude_desired, self.oscillation_frequency
        missing = abs(self.force_rendered - self.force)  # a short force hardly counts in the error over all time
        force = f"{self.force_rendered:.2f} of {self.force:.2f} N, error {self.error:.2f} N"
        tests = [
            (abs(self.stiffness - stiffness) > STIFFNESS_JND * stiffness,
             f"stiffness {self.stiffness:.0f} of {stiffness:.0f} N/m"),
            (self.share_low * stiffness < (1.0 - STIFFNESS_JND) * self.share_high * stiffness,
             f"stiffness between {self.share_low * stiffness:.0f} and {self.share_high * stiffness:.0f} N/m"),
            (self.amplitude < MIN_AMPLITUDE * amplitude or self.amplitude > amplitude / MIN_AMPLITUDE,
             f"vibrates with {self.amplitude:.2f} of {amplitude:.2f} N"),
            (max(self.error_jnd, missing / just_noticeable(self.force)) > MAX_ERROR_JND,
             f"{force} ({self.error_jnd:.0f} JND)"),
            (self.direction > MAX_ANGLE_DEG, f"{self.direction:.0f} degrees off"),
            (self.free_force > MIN_FORCE_N, f"{self.free_force:.2f} N where none is desired"),
            (self.oscillation > 0.0, f"oscillates at {hertz:.0f} Hz, {self.oscillation:.2f} N"),
        ]  # fmt: skip
        return tuple(text for failed, text in tests if failed)


def force_fidelity(
    time: Floats,
    position: Floats,
    desired: Floats,
    measured: Floats,
    frequency: Floats | float = 0.0,
    amplitude: Floats | float = 0.0,
    gain: Floats | float = 1.0,
    share: Floats | float = 1.0,
    *,
    spring: bool = True,
) -> Fidelity:
    """Return the fidelity of a force from its record.

    Parameters
    ----------
    time : (K,) array
        In s, increasing; gaps separate the times at which the effect was active.
    position, desired, measured : (K, d) arrays
        Position of the hand in m; desired and measured force on it in N.
    frequency : (K,) array or float
        Frequency that the effect has by itself (ripples that pass, a vibration), in Hz; 0: none.
    amplitude : (K,) array or float
        Of a vibration that ``desired`` does not contain, in N.
    gain : (K,) array or float
        That vibration's amplitude on the hand per amplitude in ``measured``.
    share : (K,) array or float
        Share of a softened parameter that the loop renders; 1: nothing is softened.
    spring : bool
        Whether the effect has a stiffness or damping.

    Examples
    --------
    A wall that is rendered at a fifth of its stiffness:

    >>> import numpy as np
    >>> from tensionlab.haptics.rendering.fidelity import force_fidelity
    >>> time = np.arange(0.0, 2.0, 0.01)
    >>> depth = 0.01 * (1.0 - np.cos(2.0 * np.pi * time))[:, None]
    >>> found = force_fidelity(time, -depth, 200.0 * depth, 40.0 * depth)
    >>> found.failures()[0]
    'stiffness 40 of 200 N/m'
    """
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.01
    frequency, amplitude = (np.broadcast_to(values, time.shape) for values in (frequency, amplitude))
    parts = np.split(np.arange(len(time)), np.flatnonzero(np.diff(time) > 2.5 * step) + 1)
    measured, shaking = _without_vibration(time, measured, frequency, amplitude, parts, step)
    error, size = measured - desired, norm(desired)
    wanted = size > 0.05 * max(float(size.max(initial=0.0)), MIN_FORCE_N)
    force = rms(size[wanted]) if wanted.any() else 0.0
    jnd = just_noticeable(force)
    strong = size > MIN_FORCE_N
    off = angles(measured[strong], desired[strong]) if strong.any() else np.zeros(0)
    axis = np.linalg.svd(desired - desired.mean(axis=0), full_matrices=False)[2][0]  # of the largest changes
    stiff = [_impedance(time, position, desired, forces, parts, wanted & spring) for forces in (desired, measured)]
    low, high = np.quantile(np.broadcast_to(share, time.shape), (0.1, 0.9)).tolist()
    wave, hertz = _oscillation(measured, error, frequency, parts, step)
    bandwidth, excited = _bandwidth(desired, measured, parts, step)
    return Fidelity(
        force=force,
        force_rendered=force * float(np.sum(measured * desired)) / max(float(np.sum(desired**2)), 1e-12),
        stiffness_desired=stiff[0][0],
        stiffness=stiff[1][0] + 0.0 * stiff[0][0],
        damping_desired=stiff[0][1],
        damping=stiff[1][1] + 0.0 * stiff[0][1],
        amplitude_desired=float(amplitude.max(initial=0.0)) or NAN,
        amplitude=shaking * float(np.mean(gain)),
        bandwidth=bandwidth,
        excited=excited,
        error=rms(norm(error)),
        error_peak=float(norm(error).max(initial=0.0)),
        error_jnd=rms(norm(error)) / jnd,
        direction=float(np.average(off, weights=size[strong])) if off.size else NAN,
        free_force=_free_force(time, measured, desired, wanted, parts, step),
        oscillation=wave if wave > jnd else 0.0,
        oscillation_frequency=hertz if wave > jnd else NAN,
        latency=_latency(time, desired @ axis, measured @ axis),
        share_low=low,
        share_high=high,
    )


def rms(values: Floats) -> float:
    """Return the root mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else NAN


def _free_force(
    time: Floats, force: Floats, desired: Floats, wanted: NDArray[np.bool_], parts: Parts, step: float
) -> float:
    """Return the largest force that is held where none is desired; close to a desired one, only against it."""
    wrong = force
    if wanted.any():
        times, ways = time[wanted], normalized(desired[wanted])
        nearest = np.searchsorted((times[1:] + times[:-1]) / 2.0, time)
        against = np.minimum(np.vecdot(force, ways[nearest]), 0.0)[:, None] * ways[nearest]
        wrong = np.where((abs(times[nearest] - time) < MAX_LATENCY_S)[:, None], against, force)
    length = max(round(HELD_S / step), 1)
    held = [norm(wrong[window].mean(axis=0)) for window in _windows(parts, length) if not wanted[window].any()]
    return float(max(held, default=NAN))


def _windows(parts: Parts, length: int) -> Iterator[NDArray[np.intp]]:
    """Yield windows of a number of samples that overlap by half."""
    for part in parts:
        for begin in range(0, len(part) - length + 1, max(length // 2, 1)):
            yield part[begin : begin + length]


def _without_vibration(
    time: Floats, measured: Floats, frequency: Floats, amplitude: Floats, parts: Parts, step: float
) -> tuple[Floats, float]:
    """Return the measured force without the vibration, and its amplitude; NaN if it fades or is too fast."""
    shares, rest = [], measured.copy()
    length = max(round(VIBRATION_S / step), 8)
    for part in parts:
        for window in np.array_split(part, max(len(part) // length, 1)):
            size, hertz = float(amplitude[window].mean()), float(frequency[window].mean())
            if size <= 0.1 * amplitude.max() or len(window) < 6:  # none, or it has faded
                continue
            phase, late = 2.0 * math.pi * hertz * time[window], time[window] - time[window].mean()
            waves = amplitude[window, None] * np.stack([np.sin(phase), np.cos(phase)], axis=1)
            columns = np.concatenate([waves, np.stack([np.ones_like(late), late], axis=1)], axis=1)
            fitted = np.linalg.lstsq(columns, measured[window], rcond=None)[0][:2]
            rest[window] -= waves @ fitted
            if amplitude[window].min() > STEADY * size:
                shares.append(float(np.linalg.norm(fitted)) if 2.0 * hertz * step < 1.0 else NAN)
    return rest, float(amplitude.max() * np.mean(shares)) if shares else NAN


def _impedance(
    time: Floats, position: Floats, desired: Floats, force: Floats, parts: Parts, wanted: NDArray[np.bool_]
) -> tuple[float, float]:
    """Return stiffness and damping along the desired force, by its penetration: minus the path along it."""
    rows, pushes = [], []
    for part in parts:
        contacts = np.split(part, np.flatnonzero(np.diff(wanted[part].astype(int))) + 1)
        for contact in contacts:
            if len(contact) < 6 or not wanted[contact[0]]:
                continue
            way = normalized(desired[contact])
            step = np.vecdot(np.diff(position[contact], axis=0), (way[1:] + way[:-1]) / 2.0)
            depth = -np.concatenate([[0.0], np.cumsum(step)])
            speed = np.gradient(depth, time[contact])
            push = np.vecdot(force[contact], way)
            rows.append(np.stack([depth - depth.mean(), speed - speed.mean()], axis=1))
            pushes.append(push - push.mean())
    if not rows:
        return NAN, NAN
    columns, push = np.concatenate(rows), np.concatenate(pushes)
    fitted = np.linalg.lstsq(columns, push, rcond=None)[0]
    shares = np.std(columns * fitted, axis=0) / max(float(np.std(push)), 1e-9)
    explained = 1.0 - np.var(push - columns @ fitted) / max(float(np.var(push)), 1e-12)
    if force is desired and explained < MIN_FIT:
        return NAN, NAN
    values = np.where((shares > MIN_SHARES) & (fitted > 0.0), fitted, NAN) if force is desired else fitted
    return float(values[0]), float(values[1])


def _bandwidth(desired: Floats, measured: Floats, parts: Parts, step: float) -> tuple[float, float]:
    """Return the frequency up to which amplitudes stay within 3 dB, and the highest that was excited."""
    length = min(max((len(part) for part in parts), default=0), max(round(1.0 / step), 16))
    if length < 16:
        return NAN, NAN
    taper = np.hanning(length)[:, None]
    spectra = [
        [
            np.fft.rfft((forces[window] - forces[window].mean(axis=0)) * taper, axis=0)
            for forces in (desired, measured)
        ]
        for window in _windows(parts, length)
    ]
    wanted, came = np.stack(spectra, axis=1)  # (windows, frequencies, d) each
    power, cross = (abs(wanted) ** 2).sum(axis=(0, 2)), (wanted.conj() * came).sum(axis=(0, 2))
    coherence = abs(cross) ** 2 / np.maximum(power * (abs(came) ** 2).sum(axis=(0, 2)), 1e-30)
    counts = (power > MIN_EXCITATION * power.max()) & (coherence > MIN_COHERENCE) & (power > 0.0)
    counts[0] = False
    bins = np.flatnonzero(counts)
    if not bins.size:
        return NAN, NAN
    gain, hertz = abs(cross[bins]) / power[bins], bins / (length * step)
    outside = np.flatnonzero((gain < MIN_AMPLITUDE) | (gain > 1.0 / MIN_AMPLITUDE))
    end = outside[0] if outside.size else len(bins)
    return (float(hertz[end - 1]) if end else 0.0), float(hertz[-1])


def _oscillation(
    measured: Floats, error: Floats, frequency: Floats, parts: Parts, step: float
) -> tuple[float, float]:
    """Return amplitude and frequency of the strongest lasting oscillation that is not desired."""
    length = round(OSCILLATION_S / step)
    strongest, sizes, peaks = (0.0, NAN), [0.0] * LASTING, [-9] * LASTING
    if length < 12:
        return strongest
    taper, resolution = np.hanning(length), 1.0 / (length * step)
    late = np.linspace(-1.0, 1.0, length)
    smooth = np.linalg.pinv(np.stack([late**0, late, late**2], axis=1))
    first = math.ceil(MIN_OSCILLATION_HZ / resolution)
    for window in _windows(parts, length):
        force = np.concatenate([measured[window], error[window]], axis=1)
        force = force - np.stack([late**0, late, late**2], axis=1) @ (smooth @ force)
        both = abs(np.fft.rfft(force * taper[:, None], axis=0)) ** 2
        power, wrong = both[:, : measured.shape[1]].sum(axis=1), both[:, measured.shape[1] :].sum(axis=1)
        peak = first + int(np.argmax(power[first:]))
        line = slice(max(peak - 2, 0), peak + 3)
        size = math.sqrt(4.0 * float(power[line].sum()) / (length * float(np.sum(taper**2))))
        own = frequency[window]
        intended = own.max() > 0.0 and own.min() / resolution - 2 <= peak <= own.max() / resolution + 2
        narrow = power[peak] > power[peak - 1] and power[line].sum() > NARROW * power[first:].sum()
        if intended or not narrow or wrong[line].sum() < OWN_SHARE**2 * power[line].sum():
            size = 0.0
        sizes, peaks = [*sizes[1:], size], [*peaks[1:], peak]
        if max(peaks) - min(peaks) <= 1 and min(sizes) > strongest[0]:
            strongest = min(sizes), peak * resolution
    return strongest


def _latency(time: Floats, desired: Floats, measured: Floats) -> float:
    """Return the delay at which the desired force explains the measured one best; NaN if it hardly varies."""
    if len(time) < 8 or min(np.std(desired), np.std(measured)) < MIN_JND_N:
        return NAN
    delays = np.arange(0.0, MAX_LATENCY_S, 1e-3)
    delayed = np.interp(time - delays[:, None], time, desired)
    delayed -= delayed.mean(axis=1, keepdims=True)
    varied = measured - measured.mean()
    with np.errstate(invalid="ignore"):  # a delayed force that is constant explains nothing
        scores = delayed @ varied / (np.linalg.norm(delayed, axis=1) * np.linalg.norm(varied))
    best = int(np.argmax(np.nan_to_num(scores)))
    return float(delays[best]) if scores[best] ** 2 > 0.5 else NAN
