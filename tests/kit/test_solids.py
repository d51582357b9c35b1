"""The kit's parts can be printed, fit together, and brake."""

import importlib.util
import math
from itertools import combinations

import numpy as np
import pytest

from kit import parameters as p

if importlib.util.find_spec("build123d") is None:
    pytest.skip("no CAD library here: `make kit` installs it", allow_module_level=True)

from kit import assembly, brake
from kit.render import triangles

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::DeprecationWarning")]
PARTS = sorted(assembly.printed())


@pytest.fixture(scope="module")
def printed():
    return assembly.printed()


def shared(one, other):
    """Return the volume in mm3 that two parts share."""
    a, b = one.bounding_box(), other.bounding_box()
    if any(x >= y for low, high in ((a.min, b.max), (b.min, a.max)) for x, y in zip(low, high, strict=True)):
        return 0.0
    both = one & other
    return both.volume if both else 0.0


def meshed(part):
    """Return the vertices of a part's surface, without repetitions, and its triangles."""
    mesh = triangles(part)
    vertices, faces = np.unique(mesh.reshape(-1, 3).round(5), axis=0, return_inverse=True)
    return vertices, faces.reshape(-1, 3)


@pytest.mark.parametrize("name", PARTS)
def test_each_part_is_one_valid_closed_solid(printed, name):
    part = printed[name]
    assert part.is_valid
    assert len(part.solids()) == 1
    vertices, faces = meshed(part)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    there = {tuple(edge) for edge in edges.tolist()}
    assert len(there) == len(edges)  # each edge once in either direction: closed, all faces outwards
    assert there == {(b, a) for a, b in there}
    corners = vertices[faces]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume == pytest.approx(part.volume, rel=0.01)


@pytest.mark.parametrize("name", PARTS)
def test_walls_are_thick_enough_to_print(printed, name):
    assert thinnest_wall(triangles(printed[name])) >= p.minimum_wall - 0.02


def thinnest_wall(mesh, samples=3000):
    """Return the shortest way in mm from points of a surface straight inwards to a face that looks the other way.

    Wedges, as the tips of teeth, are no walls: there the faces do not look away from each other.
    """
    random = np.random.default_rng(7)
    a, ab, ac = mesh[:, 0], mesh[:, 1] - mesh[:, 0], mesh[:, 2] - mesh[:, 0]
    normals = np.cross(ab, ac)
    areas = np.linalg.norm(normals, axis=1)
    a, ab, ac, normals, areas = (values[areas > 1e-9] for values in (a, ab, ac, normals, areas))
    normals = normals / areas[:, None]
    # By the root of their areas, so that small walls are looked at as well.
    chosen = random.choice(len(a), samples, p=np.sqrt(areas) / np.sqrt(areas).sum())
    u, v = random.random((2, samples, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    thinnest = math.inf
    for origin, inwards in zip(a[chosen] + u * ab[chosen] + v * ac[chosen], -normals[chosen], strict=True):
        opposite = normals @ inwards > math.cos(math.radians(10))
        slope = np.cross(inwards, ac[opposite])
        determinant = (ab[opposite] * slope).sum(axis=1)
        to = origin - a[opposite]
        across = np.cross(to, ab[opposite])
        first, second = (to * slope).sum(axis=1) / determinant, across @ inwards / determinant
        distance = (across * ac[opposite]).sum(axis=1) / determinant
        hit = (first >= 0) & (second >= 0) & (first + second <= 1) & (distance > 1e-4)
        thinnest = min(thinnest, distance[hit].min(initial=math.inf))
    return thinnest


@pytest.mark.parametrize("lifted", [False, True])
def test_assembled_parts_keep_out_of_each_other(lifted):
    parts = assembly.assembled(lifted)
    for one, other in combinations(parts, 2):
        assert shared(parts[one], parts[other]) < 1e-6, (one, other)


def test_the_pawl_blocks_paying_out_and_lets_reel_in():
    pitch = 360 / p.teeth
    laid, lifted = brake.pawl(), brake.pawl(p.pawl_lift)
    for turn in np.linspace(0.05, 0.8, 4) * pitch:
        assert shared(brake.ratchet(turn), laid) > 0.01  # counter-clockwise, the cable pays out
        assert shared(brake.ratchet(turn), lifted) == 0
    rides = []
    for share in (0.5, 0.65, 0.8, 0.95):
        wheel = brake.ratchet(-share * pitch)
        angles = np.arange(0, p.pawl_lift + 0.1, 0.75)
        free = [shared(wheel, brake.pawl(angle)) == 0 for angle in angles]
        assert free[-1]
        assert free == sorted(free)  # from where it rides it comes off, with the wheel as it is
        rides.append(angles[free.index(True)])
    assert rides == sorted(rides)  # the slope lifts it as the cable reels in
    assert 0 < rides[-1] < p.pawl_lift
    # Under load it does not come off: the firmware reels half a tooth in first.
    assert shared(brake.ratchet(), brake.pawl(1.0)) > 0


def test_the_horn_lifts_the_pawl_and_lets_it_down():
    lifting, free = assembly.purchased(lifted=True)["horn"], assembly.purchased()["horn"]
    assert shared(lifting, brake.pawl(p.pawl_lift)) == 0
    assert shared(lifting, brake.pawl(p.pawl_lift - 2.0)) > 0
    assert all(shared(free, brake.pawl(angle)) == 0 for angle in (0.0, p.pawl_lift / 2, p.pawl_lift))


def test_the_encoder_sees_its_magnet():
    assert 0.5 <= p.encoder_gap <= 2.5
    parts = assembly.purchased()
    gap = parts["magnet"].bounding_box().min.Z - parts["encoder"].bounding_box().max.Z
    assert gap == pytest.approx(p.encoder_gap)
