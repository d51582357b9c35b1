"""Numbers of fidelity, on forces that were made with known errors."""

import numpy as np
import pytest

from tensionlab.haptics.rendering.fidelity import force_fidelity, just_noticeable

STEP = 0.005
TIME = np.arange(0.0, 8.0, STEP)
AXIS = np.array([0.6, 0.0, 0.8])
NOTHING = np.zeros((len(TIME), 3))


def smooth(seed, highest=2.0):
    """Return a random motion up to a frequency in Hz, with a standard deviation of 1 cm."""
    draw = np.random.default_rng(seed)
    hertz = np.linspace(0.2, highest, 12)
    waves = np.sin(2 * np.pi * np.outer(TIME, hertz) + draw.uniform(0, 2 * np.pi, hertz.size))
    return 0.01 * waves.sum(axis=1) / np.std(waves.sum(axis=1))


def along(force, axis=AXIS):
    return np.asarray(force)[:, None] * axis


def judged(desired, measured, position=NOTHING, **more):
    return force_fidelity(TIME, position, desired, measured, **more)


@pytest.mark.parametrize(("stiffness", "delay"), [(200.0, 0.0), (40.0, 0.0), (70.0, 0.02), (150.0, 0.03)])
def test_stiffness_damping_and_delay_are_those_with_which_a_wall_was_rendered(stiffness, delay):
    """A spring that is late by tau is one with the damping minus K tau (Gil et al. 2009)."""
    depth = 0.03 + smooth(1)
    late = np.interp(TIME - delay, TIME, depth)
    wanted = 200.0 * np.maximum(depth, 0.0)
    found = judged(along(wanted), along(stiffness * np.maximum(late, 0.0)), -along(depth))
    assert found.stiffness_desired == pytest.approx(200.0, rel=0.01)
    assert found.stiffness == pytest.approx(stiffness, rel=0.05)
    assert found.latency == pytest.approx(delay, abs=0.002)
    damped = judged(along(wanted + 4.0 * np.gradient(depth, TIME)), along(stiffness * late), -along(depth))
    assert damped.damping_desired == pytest.approx(4.0, rel=0.05)
    assert damped.damping == pytest.approx(-stiffness * delay, abs=0.3)
    assert any("stiffness" in failure for failure in found.failures()) == (stiffness < 200.0 * (1 - 0.23))


def test_a_ball_is_as_stiff_as_a_wall():
    angle = smooth(3) * 60.0
    way, depth = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1), 0.02 + 0.3 * smooth(4)
    position = (0.08 - depth)[:, None] * way
    found = judged(300.0 * depth[:, None] * way, 90.0 * depth[:, None] * way, position)
    assert (found.stiffness_desired, found.stiffness) == pytest.approx((300.0, 90.0), rel=0.02)
    assert not np.isfinite(judged(300.0 * depth[:, None] * way, NOTHING, position, spring=False).stiffness)


def test_errors_are_in_newtons_and_in_just_noticeable_differences():
    found = judged(along(np.full(len(TIME), 4.0)), along(np.full(len(TIME), 3.0)))
    assert (found.force, found.force_rendered, found.error, found.error_peak) == pytest.approx(
        (4.0, 3.0, 1.0, 1.0)
    )
    assert found.error_jnd == pytest.approx(1.0 / 0.28)
    assert found.failures() == ()
    assert [just_noticeable(force) for force in (10.0, 1.0, 0.0)] == pytest.approx([0.7, 0.1, 0.05])
    weak = judged(along(np.full(len(TIME), 2.03)), along(np.full(len(TIME), 0.90)))
    assert weak.failures() == ("0.90 of 2.03 N, error 1.13 N (6 JND)",)


def test_a_direction_is_weighted_by_the_force():
    desired = along(np.where(TIME < 4.0, 3.0, 1.0))
    turned = np.where(TIME[:, None] < 4.0, 3.0, 1.0) * np.array([0.8, 0.0, -0.6])
    mixed = np.where(TIME[:, None] < 4.0, turned, desired)
    assert judged(desired, mixed).direction == pytest.approx(0.75 * 90.0, rel=0.01)
    assert "68 degrees off" in judged(desired, mixed).failures()


def test_a_pull_where_nothing_is_desired_is_a_failure_if_it_lasts():
    desired = along(np.where(TIME < 4.0, 2.0, 0.0))
    pull = along(np.where((TIME > 6.0) & (TIME < 6.3), -0.9, 0.0))
    spike = along(np.where((TIME > 6.0) & (TIME < 6.012), -0.9, 0.0))
    assert judged(desired, desired + pull).failures() == ("0.90 N where none is desired",)
    assert judged(desired, desired + spike).failures() == ()


@pytest.mark.parametrize("cutoff", [5.0, 12.0, 25.0])
def test_the_bandwidth_is_where_3_db_are_lost(cutoff):
    chirp = np.sin(2 * np.pi * (0.5 * TIME + 0.5 * 40.0 / TIME[-1] * TIME**2))
    spectrum = np.fft.rfft(chirp, 2 * len(chirp))
    hertz = np.fft.rfftfreq(2 * len(chirp), STEP)
    came = np.fft.irfft(spectrum / (1.0 + 1j * hertz / cutoff))[: len(chirp)]
    found = judged(along(2.0 * chirp), along(2.0 * came))
    assert found.bandwidth == pytest.approx(cutoff, abs=1.0)
    assert found.excited > 30.0
    assert judged(along(2.0 * chirp), along(2.0 * chirp)).bandwidth == found.excited


@pytest.mark.parametrize(("frequency", "amplitude"), [(59.0, 0.9), (8.0, 0.6)])
def test_a_limit_cycle_is_named_by_frequency_and_amplitude(frequency, amplitude):
    weight = along(np.full(len(TIME), -4.9))
    buzz = along(amplitude * np.sin(2 * np.pi * frequency * TIME))
    found = judged(weight, weight + buzz, spring=False)
    assert found.oscillation_frequency == pytest.approx(frequency, abs=1.0)
    assert found.oscillation == pytest.approx(amplitude, rel=0.1)
    assert found.failures() == (f"oscillates at {found.oscillation_frequency:.0f} Hz, {found.oscillation:.2f} N",)


def test_what_is_desired_or_happens_once_is_no_oscillation():
    ripple = along(np.sin(2 * np.pi * 8.0 * TIME))
    load = along(np.full(len(TIME), 2.0))
    assert judged(load + ripple, load + ripple).oscillation == 0.0
    assert judged(load, load + 0.4 * ripple, frequency=8.0).oscillation == 0.0  # its own, and late
    hit = along(np.where(TIME > 4.0, np.exp(-(TIME - 4.0) / 0.1) * np.sin(50.0 * (TIME - 4.0)), 0.0))
    assert judged(load, load + hit).oscillation == 0.0


@pytest.mark.parametrize("amplitude", [0.24, 0.70, 0.72, 1.0, 1.40, 1.42, 1.9])
def test_the_amplitude_of_a_vibration_stays_within_3_db_on_both_sides(amplitude):
    shaking = along(amplitude * np.sin(2 * np.pi * 40.0 * TIME + 1.0))
    found = judged(NOTHING, shaking, frequency=40.0, amplitude=1.0, spring=False)
    assert found.amplitude == pytest.approx(amplitude, rel=0.005)
    wrong = abs(20.0 * np.log10(amplitude)) > 3.0
    assert found.failures() == ((f"vibrates with {amplitude:.2f} of 1.00 N",) if wrong else ())
    reported = judged(NOTHING, shaking / 1.9, frequency=40.0, amplitude=1.0, gain=1.9, spring=False)
    assert reported.amplitude == pytest.approx(found.amplitude)


def test_the_amplitude_of_a_vibration_is_known_if_it_lasts_and_the_record_is_fast_enough():
    fading = 1.0 * np.exp(-TIME / 0.05)
    hum = along(2.0 * fading * np.sin(2 * np.pi * 40.0 * TIME))
    assert np.isnan(judged(NOTHING, hum, frequency=40.0, amplitude=fading, spring=False).amplitude)
    slow = slice(None, None, 4)  # 50 Hz, in which 60 Hz look like 10 Hz
    fast = along(np.sin(2 * np.pi * 60.0 * TIME))[slow]
    aliased = force_fidelity(TIME[slow], fast, 0 * fast, fast, frequency=60.0, amplitude=1.0, spring=False)
    assert np.isnan(aliased.amplitude)
    assert (aliased.oscillation, aliased.error) == pytest.approx((0.0, 0.0), abs=0.02)


def test_a_record_of_a_moment_or_of_nothing_has_no_numbers_and_no_failures():
    for count in (1, 2, 7):
        found = force_fidelity(TIME[:count], *[NOTHING[:count]] * 3)
        assert found.failures() == ()
        assert np.isnan(found.stiffness)
