"""What a module and the host render of an effect is together the effect, wherever the hand is and goes."""

import numpy as np
import pytest

from tensionlab.haptics.effects import (
    AxisImpedance,
    Bow,
    Magnet,
    Motion,
    Plane,
    Shape,
    Sphere,
    Spring,
    Texture,
    VirtualCoupling,
    Wall,
)
from tests.helpers.motions import at

TILTED = Plane(point=(0.1, -0.05, 0.2), normal=(1.0, -2.0, 3.0))
SPLIT = {
    "spring": Spring(centre=(0.1, -0.2, 0.05), damping=3.0),
    "wall": Wall(TILTED),
    "texture": Texture(Wall(TILTED)),
    "bow": Bow(),
    "magnet": Magnet(TILTED, stiffness=60.0, reach=0.2),
    "ball": Shape(Sphere(centre=(0.1, -0.2, 0.05), radius=0.2), VirtualCoupling(damping=3.0)),
}
# Effects whose module damps motion along its axis; motion across is not damped.
ALONG_ONLY = {"magnet", "ball"}


@pytest.mark.parametrize("name", SPLIT)
def test_what_a_module_and_the_host_render_adds_up_to_the_effect(name):
    effect, rng = SPLIT[name], np.random.default_rng(1)
    near = TILTED.point + rng.uniform(-3e-4, 3e-4, (10, 3))
    positions = np.concatenate([rng.uniform(-0.3, 0.3, (200, 3)), near])
    parts = 0
    for position, velocity in zip(positions, rng.uniform(-0.3, 0.3, positions.shape), strict=True):
        part = effect.module_side(Motion(position, velocity))
        if part is None:
            continue
        parts += 1
        inward = -abs(velocity @ part.axis) * part.axis  # on the way out a module does not damp
        across = velocity - (velocity @ part.axis) * part.axis
        motion = Motion(position, inward if name in ALONG_ONLY else inward + across)
        together = part.push(motion.velocity) + effect.host_side(motion).force
        assert together == pytest.approx(effect.render(motion).force, abs=1e-9)
    assert parts >= 60


@pytest.mark.parametrize(
    ("effect", "nothing", "something"),
    [
        (Spring(), 0.0, 5e-4),
        (Bow(), 0.0, 5e-4),
        (Bow(let_off=0.7), 0.3, None),
        (Magnet(reach=0.1), 0.101, 0.099),
    ],
)
def test_a_module_renders_nothing_where_an_effect_has_no_direction_or_no_force(effect, nothing, something):
    assert effect.module_side(at(0.0, 0.0, nothing)) is None
    if something is not None:
        assert effect.module_side(at(0.0, 0.0, something)) is not None


def test_a_module_knows_how_far_a_surface_still_is():
    for distance in (0.002, 0.05):
        assert SPLIT["wall"].module_side(Motion(TILTED.point + distance * TILTED.n, np.zeros(3))).compression == (
            pytest.approx(-distance)
        )
        assert Shape().module_side(at(0.0, 0.1 + distance, 0.0)).compression == pytest.approx(-distance)


def test_an_impedance_damps_from_the_surface_on_and_only_on_the_way_in():
    axis = np.array([0.0, 0.6, 0.8])
    for depth, speed, force in ((1e-9, -0.5, 1.0), (1e-9, 0.5, 0.0), (0.0, -0.5, 0.0), (-1e-9, -0.5, 0.0)):
        push = AxisImpedance(axis, depth, stiffness=300.0, damping=2.0).push(speed * axis)
        assert push == pytest.approx(force * axis, abs=1e-6)
