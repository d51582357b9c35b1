import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.plots import plot_error_sphere, plot_forces
from tensionlab.plots.forces import _deviations, _on_disc
from tests.support.recorded import made_up

RIG = Path(__file__).parents[2] / "datasets" / "rigs" / "bartels2026-validation.toml"


def words_of(path):
    return re.findall(r"<!-- (.*?) -->", path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def draw():
    rig = tl.load_rig(RIG)
    return {"forces": plot_forces, "sphere": lambda recording, path: plot_error_sphere(recording, rig, path)}


@pytest.mark.parametrize("name", ["forces", "sphere"])
def test_the_same_recording_makes_the_same_file_and_another_another(tmp_path, draw, name):
    for suffix in (".png", ".pdf"):
        paths = [tmp_path / f"{number}{suffix}" for number in range(3)]
        draw[name](made_up(), paths[0])
        draw[name](made_up(), paths[1])
        draw[name](made_up(seed=1), paths[2])
        assert paths[0].read_bytes() == paths[1].read_bytes()
        assert paths[0].read_bytes() != paths[2].read_bytes()


def test_pictures_say_what_they_show_and_that_it_is_simulated(tmp_path, draw):
    draw["forces"](made_up(), tmp_path / "a.svg")
    words = words_of(tmp_path / "a.svg")
    assert "bartels2026-validation, simulated: 182 forces of 1.5 N, solver newton" in words
    assert {"from the front (along −z)", "from above (along −y)", "force asked for"} <= set(words)
    draw["sphere"](made_up(simulated=False), tmp_path / "b.svg")
    words = words_of(tmp_path / "b.svg")
    assert "bartels2026-validation, measured: 182 forces of 1.5 N, solver newton" in words
    assert {"angle to the force asked for (°)", "size: felt minus asked for (N)", "top", "floor-3"} <= set(words)


def test_angles_and_sizes_are_those_of_the_planted_error():
    recording = made_up(gain=1.2, noise=0.0)
    c, s = np.cos(0.2), np.sin(0.2)
    turned = replace(recording, measured=recording.measured @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))
    angle, size = _deviations(turned)
    np.testing.assert_allclose(size, 0.2 * 1.5)
    assert angle.max() == pytest.approx(np.degrees(0.2))


def test_the_disc_keeps_areas_and_has_each_direction_once_but_on_the_rim():
    vectors = made_up().desired
    up, there = _on_disc(vectors, 1.0)
    down, below = _on_disc(vectors, -1.0)
    assert len(up) + len(down) == 182 + np.count_nonzero(np.abs(vectors[:, 1]) < 1e-9)
    assert np.count_nonzero(there & below) == 20
    # A cap up to the angle a from the pole has the area 2 pi (1 - cos a); on the disc it is pi r².
    cosine = vectors[there, 1] / 1.5
    np.testing.assert_allclose(np.sum(up**2, axis=1), 1 - cosine, atol=1e-12)
