"""A simulated module with known limits: characterisation finds them."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import tensionlab as tl
from tensionlab.demand import Demand
from tensionlab.errors import RigError
from tensionlab.haptics.rendering.stability import stiffness_bound
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.model.module import Module
from tensionlab.validation import characterisation, measurements, simulated_hand
from tensionlab.validation.characterisation import CharacterisationPlan
from tensionlab.validation.characterisation_report import wall_limits
from tensionlab.validation.measurements import FrequencyResponse, Recorder, WallTrial
from tensionlab.validation.protocol import read_zero
from tensionlab.validation.simulated_hand import HandRequest

RIG = tl.load_rig("bartels2026-validation")
X = np.eye(3)[0]
# Neither friction nor cogging; the cable is damped so well that the spool does not swing.
CLEAN = {"dry_friction": 0.0, "viscous_friction": 0.0, "cogging": 0.0, "damping": 25.0}
HAND_KG, HAND_NS_M = simulated_hand.HAND_MASS_KG, 2.0
STILL, MOVE, LOOSE = (HandRequest(grip, RIG.home) for grip in ("hold", "move", "loose"))


@pytest.fixture(autouse=True)
def short_zero(monkeypatch):
    """Average the sensor at zero tension for less time than a real one needs."""
    monkeypatch.setattr("tensionlab.validation.protocol.ZERO_S", 0.3)


def measured(request, measuring, latency=0.01, rate=50.0, **plant):
    """Measure a simulated rig whose modules have these hardware parameters."""
    plan = CharacterisationPlan(RIG, rate, conditions=Conditions(latency), plant=CLEAN | plant)
    modules, clock, sensor = characterisation.simulated_bench(plan)(request)
    recorder = Recorder(sensor, read_zero(modules, clock, sensor), np.eye(3), latency)
    return characterisation.run_measurement(plan, modules, clock, recorder, measuring(recorder)), recorder


@pytest.mark.parametrize(
    ("friction", "viscous", "latency"), [(0.15, 0.0, 0.0), (0.08, 0.2, 0.01), (0.1, 0.1, 0.02)]
)
def test_friction_of_the_cables_is_found_in_free_motion(friction, viscous, latency):
    plant = {"dry_friction": friction, "viscous_friction": viscous}
    found, _ = measured(MOVE, lambda r: measurements.free_motion(r, RIG, 12.0), latency, **plant)
    assert found.friction == pytest.approx(friction, rel=0.05)
    assert found.damping == pytest.approx(viscous, abs=0.02)
    assert found.tension == pytest.approx(0.5, abs=0.01)
    structure = RIG.structure_matrix(RIG.home)
    felt, _, mass = found.along(structure, X)
    assert felt == pytest.approx(found.friction * np.abs(structure[0]).sum())
    # Rotor and spool; the current falls behind an accelerating motor, which adds to them.
    spool = 1.2e-5 / 0.0195**2 * float(structure[0] @ structure[0])
    assert spool < mass < 1.6 * spool


@pytest.mark.parametrize("rate", [20.0, 30.0])
def test_a_host_that_holds_its_forces_for_a_cycle_has_the_bandwidth_of_that(rate):
    frequencies = rate * characterisation.RATE_SHARES
    found, _ = measured(STILL, lambda r: measurements.force_response(r, X, 0.3, frequencies, rate), rate=rate)
    held = brentq(lambda frequency: np.sinc(frequency / rate) - math.sqrt(0.5), 0.3 * rate, 0.5 * rate)
    assert found.bandwidth == pytest.approx(held, rel=0.1)


# Control of the current (gains, filter in s) and winding (ohm, H), of firmware/esp32/board.hpp and of `PLANT`.
PROPORTIONAL, INTEGRAL, FILTER_S, RESISTANCE, INDUCTANCE = 0.5, 1400.0, 5e-4, 2.8, 1e-3
TENSION_N_A, EMF_V_S_M = 3.0, 2.0  # per current, and per speed of the cable: two thirds of the first


@pytest.mark.parametrize(("stiffness", "damping"), [(300.0, 4.0), (4000.0, 25.0)])
def test_vibrations_are_limited_by_cable_spool_and_current(stiffness, damping):
    mass = 1.2e-5 / 0.0195**2

    def gain(frequency):
        s = 2j * math.pi * frequency
        control = PROPORTIONAL + INTEGRAL / s
        impedance = RESISTANCE + INDUCTANCE * s + control / (1.0 + FILTER_S * s)
        cable = stiffness + damping * s
        return abs(cable * control / impedance / (cable + mass * s**2 + TENSION_N_A * EMF_V_S_M * s / impedance))

    frequencies = np.geomspace(10.0, 150.0, 14)
    plant = {"stiffness": stiffness, "damping": damping}
    found, _ = measured(
        STILL, lambda r: measurements.vibration_response(r, RIG, "top", 0.05, frequencies), **plant
    )
    np.testing.assert_allclose(found.gains[:6], [gain(each) for each in frequencies[:6]], rtol=0.1)
    expected = brentq(lambda frequency: gain(frequency) - math.sqrt(0.5), 12.0, 200.0)
    assert found.bandwidth == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("latency", [0.0, 0.01, 0.03])
def test_latency_is_that_of_the_links(latency):
    found, recorder = measured(STILL, lambda r: measurements.step_response(r, X, 0.5), latency)
    assert latency < found.latency < latency + 0.01
    assert 2.0 * latency - 1e-3 <= np.nanmedian(recorder.delays) <= 2.0 * latency + 0.02


def boundary(damping, delay, age):
    """Stiffness at which a hand on a late spring and damper swings for ever: a root of its equation of motion.

    The damper is later than the spring: positions are extrapolated over the age of telemetry, and speeds are not.
    """
    current = RESISTANCE / INTEGRAL - FILTER_S
    late, mass = delay + 0.01 + current, HAND_KG + 0.05  # held for a cycle of 20 ms; with the spools
    later = late + age + 0.002  # the filter of the speed

    def stiffness(turn):
        return (mass * turn**2 - damping * turn * math.sin(turn * later)) / math.cos(turn * late)

    def gained(turn):
        lost = HAND_NS_M * turn + damping * turn * math.cos(turn * later)
        return stiffness(turn) * math.sin(turn * late) - lost

    return stiffness(brentq(gained, 1.0, 0.9 * math.pi / 2.0 / late))


@pytest.mark.parametrize(("damping", "latency"), [(0.0, 0.01), (0.0, 0.025), (2.0, 0.01)])
def test_the_stiffest_stable_wall_is_that_of_theory_for_the_delay(damping, latency):
    trials, recorder = measured(LOOSE, lambda r: measurements.wall_boundary(r, RIG, X, damping, 1.5), latency)
    stable, passive = wall_limits(trials)
    age = float(recorder.state.ages.mean())
    assert stable == pytest.approx(boundary(damping, 2.0 * latency, age), rel=0.1)
    if damping == 0.0:
        assert stable == pytest.approx(float(stiffness_bound(2.0 * latency, 0.02, HAND_NS_M)), rel=0.1)
        assert math.isnan(passive)  # a late spring without a damper is never passive
    else:
        assert passive < stable


def test_a_boundary_is_between_the_trials_beside_it():
    trials = [WallTrial(50.0, 0.0, -1.0, 1.0), WallTrial(100.0, 0.0, -0.5, -1.0), WallTrial(121.0, 0.0, 0.4, -2.0)]
    assert wall_limits(trials) == pytest.approx((110.0, 75.0))


def test_bandwidth_is_where_the_gain_falls_by_3_db():
    frequencies = np.array([1.0, 10.0, 100.0])
    assert FrequencyResponse(frequencies, np.array([1.0, 0.9, 0.8])).bandwidth == math.inf
    assert FrequencyResponse(frequencies, np.array([1.0, 1.0, 0.0])).bandwidth == pytest.approx(
        10.0 ** (1.0 + 1.0 - math.sqrt(0.5))
    )


def test_what_cannot_be_characterised_is_refused():
    modules = tuple(Module(str(x), [x, -1, x % 2], 0.5, 6.0) for x in range(3))
    down = tl.Rig("down", "point", modules, home=[0.5, 0.0, 0.5])
    with pytest.raises(RigError, match="both ways along any axis"):
        characterisation.characterise(CharacterisationPlan(down))


def test_a_demand_is_rendered_for_its_time():
    def measuring(recorder):
        return (yield from recorder.render(measurements.constant(Demand(np.array([0.0, 1.0, 0.0]))), 1.0))

    samples, _ = measured(STILL, measuring, 0.0)
    assert len(samples.states) == 50
    np.testing.assert_allclose(samples.settled().forces.mean(axis=0), [0.0, 1.0, 0.0], atol=0.02)
