"""Recordings made up for tests: forces that a sensor measures of a rig whose modules are off by a known amount."""

import numpy as np
import pandas

from tensionlab.model.directions import grid18
from tensionlab.validation.data_tables import Recording

MODULES = ["floor-1", "floor-2", "floor-3", "top"]


def made_up(gain=1.25, noise=0.3, turn=0.1, simulated=True, seed=0) -> Recording:
    """Return 182 forces of 1.5 N, measured too large, with noise, by a sensor that is turned about Y."""
    draw = np.random.default_rng(seed)
    desired = 1.5 * grid18()
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    tensions = draw.uniform(0.5, 6.0, (len(desired), len(MODULES)))
    about = {
        "simulated": simulated,
        "rig": "bartels2026-validation",
        "modules": MODULES,
        "solver": "newton",
        "sensor": "made up",
        "rotations": {"paper": rotation.tolist(), "kabsch": rotation.tolist()},
        "alignment": "paper",
        "rate": 1000.0,
        "hold": 1.0,
    }
    return Recording(
        desired=desired,
        rendered=desired,
        measured=gain * desired + draw.normal(0.0, noise, desired.shape),
        tensions=tensions,
        spread=np.full(len(desired), 0.03),
        status=np.zeros(len(desired), dtype=np.int64),
        fallback_used=np.zeros(len(desired), dtype=bool),
        samples=np.full(len(desired), 1000),
        limited_modules=np.full(len(desired), ""),
        manifest={"call": "made up", "seed": seed, "recording": about},
    )


QUESTIONS = {
    "preset": {"ideal": (0.0, 1.5), "paper-like": (13.0, 1.84)},
    "error": {"gain": (6.1, 1.9), "bias": (6.6, 1.5)},
    "solver": {"newton": (13.0, 1.84), "dykstra:10": (15.0, 1.8)},
    "calibration": {"none": (13.0, 1.84), "gain and bias": (6.0, 1.5)},
}  # by question and choice: mean angle in degrees, mean size in N


def made_up_trials(count=20) -> pandas.DataFrame:
    """Return `count` rigs for each choice, spread about known numbers."""
    draw = np.random.default_rng(0)
    rows = [
        {
            "question": question, "choice": choice, "seed": seed, "vectors": 182, "exact": 182,
            "angle": angle * factor, "angle_max": 3 * angle * factor, "magnitude": size,
            "magnitude_error": abs(size - 1.5), "vector": 0.02 * angle * factor + abs(size - 1.5),
            "within": 1.0 if angle * factor < 15 else 0.99,
        }
        for question, choices in QUESTIONS.items()
        for choice, (angle, size) in choices.items()
        for seed, factor in enumerate(draw.uniform(0.7, 1.3, count).tolist())
    ]  # fmt: skip
    return pandas.DataFrame(rows)
