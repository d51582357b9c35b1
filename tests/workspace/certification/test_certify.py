from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from benchmarks.certify import area_of_two_cables, hole_requirement, planar_platform_with_a_hole, random_positions
from benchmarks.highs import feasibility_checker, model
from tensionlab.errors import InputError, RigError, ShapeError
from tensionlab.workspace.certification import cell_problem
from tensionlab.workspace.wrench_set import required_margin
from tests.helpers.certified_cells import Cell
from tests.helpers.examples import many

certify = tl.workspace.certify
BALL = ([0.0, 0.0, 0.0], 1.0)
TETRAHEDRON = [(-0.6, 0.6), (0.0, 2.3), (-0.6, 0.6)]  # around the anchors of the published rig


def rig_of(kind, anchors, attachments=None, lower=0.0, upper=1.0):
    arms = np.zeros_like(anchors) if attachments is None else attachments
    given = {} if attachments is None else {"attachment": None}
    modules = tuple(
        tl.Module(str(i), anchor, lower, upper, **(given and {"attachment": arm}))
        for i, (anchor, arm) in enumerate(zip(np.asarray(anchors, float), np.asarray(arms, float), strict=True))
    )
    return tl.Rig("test", kind, modules, home=np.mean(anchors, axis=0))


SQUARE = rig_of("planar-point", [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def gap(proved):
    return (proved.volume.upper - proved.volume.lower) / proved.volume.upper


def test_wrench_closure_of_a_square_is_the_square():
    proved = certify(SQUARE, [(-0.3, 1.2), (-0.1, 1.4)], "wrench-closure", 0.005)
    assert proved.volume.lower <= 1.0 <= proved.volume.upper
    assert gap(proved) < 0.01
    assert proved.region_volume == pytest.approx(1.5 * 1.5)


@pytest.mark.parametrize("ratio", [1.05, 1.5])
def test_area_in_which_two_cables_hold_a_weight(ratio):
    rig = rig_of("planar-point", [[0.0, 1.0], [1.0, 1.0]], upper=ratio)
    region = [(0.0, 1.0), (0.0, 1.0)]
    coarse, fine = (certify(rig, region, [0.0, 1.0], step) for step in (0.04, 0.005))
    for proved in (coarse, fine):
        assert proved.volume.lower <= area_of_two_cables(ratio) <= proved.volume.upper
    assert gap(fine) < 1e-3


def test_bounds_come_together_as_the_square_of_the_resolution():
    rig = tl.load_rig("bartels2026-validation")
    gaps = [gap(certify(rig, TETRAHEDRON, BALL, step)) for step in (0.04, 0.02, 0.01)]
    assert gaps[1] < gaps[0] / 3
    assert gaps[2] < gaps[1] / 3
    assert gaps[2] < 0.01


@pytest.mark.parametrize(("force", "volume"), [(1.0, 0.0967), (0.5, 0.1552)])
def test_published_rig(force, volume):
    rig = tl.load_rig("bartels2026-validation")
    proved = certify(rig, TETRAHEDRON, ([0.0, 0.0, 0.0], force), 0.01)
    assert gap(proved) < 0.01
    sobol = np.random.default_rng(0).uniform(*np.array(TETRAHEDRON).T, (many(2_000_000), 3))
    share = np.mean(tl.workspace.capacity_margin(rig.structure_matrix(sobol), rig.limits) >= force)
    noise = 5 * np.sqrt(share / len(sobol))
    low, high = (each / proved.region_volume for each in proved.volume)
    assert low - noise < share < high + noise
    assert proved.volume.lower == pytest.approx(volume, rel=0.01)


CASES = {
    "published rig": ("bartels2026-validation", TETRAHEDRON, BALL, 0.04),
    "planar platform": ("kntu-planar", [(-1.3, 1.3), (-1.3, 1.3)], tl.Requirement(ball=5.0), 0.05),
    "platform": ("ipanema-2", [(-4, 4), (-3, 3), (1, 5)], tl.Requirement(gravity=True, ball=5.0), 0.4),
    "suspended": ("cogiro", [(-7, 7), (-5, 5), (0, 5)], tl.Requirement(gravity=True), 0.6),
    "eight corners": ("cube-8", [(-0.8, 0.8)] * 3, BALL, 0.1),
}


@pytest.fixture(scope="module", params=CASES, ids=str)
def case(request):
    name, region, required, resolution = CASES[request.param]
    rig = tl.load_rig(name)
    required = required if isinstance(required, tl.Requirement) else tl.Requirement(wrench=BALL[0], ball=BALL[1])
    return rig, required, certify(rig, region, required, resolution)


@pytest.mark.parametrize("verdict", [1, -1])
def test_no_pose_contradicts_the_verdict_of_its_cell(case, verdict):
    rig, required, proved = case
    positions = random_positions(proved, verdict, many(50_000), np.random.default_rng(1))
    margin = required_margin(rig, rig.structure_matrix(positions), required)
    assert (margin * verdict > 0).all()


@pytest.mark.parametrize("radius", [0.01, 0.05])
@pytest.mark.parametrize(
    ("name", "region", "wrench", "resolution"),
    [
        ("bartels2026-validation", TETRAHEDRON, [0.0, 1.0, 0.0], 0.04),
        ("kntu-planar", [(-0.8, 0.8), (-0.8, 0.8)], [0.0, 49.0, 0.0], 0.04),
        ("cogiro", [(-7, 7), (-5, 5), (0, 5)], None, 0.5),
    ],
)
def test_linear_programs_agree_with_what_is_proved_over_pulleys(name, region, wrench, resolution, radius):
    plain = tl.load_rig(name)
    axes = [plain.upward * np.copysign(1.0, plain.upward @ (plain.home - each.anchor)) for each in plain.modules]
    modules = [
        replace(each, pulley_radius=radius, pulley_axis=axis)
        for each, axis in zip(plain.modules, axes, strict=True)
    ]
    rig = replace(plain, modules=tuple(modules), bodies=())
    required = tl.Requirement(gravity=True) if wrench is None else tl.Requirement(wrench=wrench)
    proved = certify(rig, region, required, resolution)
    feasible, needed = feasibility_checker(), -rig.gravity() if wrench is None else np.asarray(wrench)
    for verdict in (1, -1):
        positions = random_positions(proved, verdict, many(2000, 500), np.random.default_rng(3))
        assert len(positions)
        programs = (
            model(each, needed, rig.limits.lower, rig.limits.upper) for each in rig.structure_matrix(positions)
        )
        assert feasible(programs) == [verdict == 1] * len(positions)


def test_closure_over_pulleys_is_that_of_single_poses():
    plain = tl.load_rig("cube-8")
    for radius in (0.02, 0.1):
        modules = (replace(each, pulley_radius=radius, pulley_axis=[0.3, 1.0, 0.2]) for each in plain.modules)
        rig = replace(plain, modules=tuple(modules), bodies=())
        proved = certify(rig, [(-1.2, 1.2)] * 3, "wrench-closure", 0.1)
        for verdict in (1, -1):
            positions = random_positions(proved, verdict, many(20_000), np.random.default_rng(4))
            assert len(positions)
            assert (tl.workspace.wrench_closure(rig.structure_matrix(positions)) == (verdict == 1)).all()


def test_pulleys_turn_with_the_frames_of_their_modules():
    """A rig on a turned frame is the rig with turned anchors and axes."""
    rng = np.random.default_rng(5)
    turn, shift = tl.model.kinematics.exponential(np.array([0.3, -0.5, 0.2])), np.array([0.1, -0.2, 0.05])
    anchors, axes = rng.uniform(-1, 1, (7, 3)), rng.normal(size=(7, 3))
    there = [
        tl.Module(str(i), anchor, 0.2, 4.0, pulley_radius=0.05, pulley_axis=axis, frame="stand")
        for i, (anchor, axis) in enumerate(zip(anchors, axes, strict=True))
    ]
    here = [
        replace(each, anchor=shift + turn @ each.anchor, pulley_axis=turn @ each.pulley_axis, frame="world")
        for each in there
    ]
    carried, plain = (tl.Rig("test", "point", tuple(modules), home=[0.0, 0.0, 0.0]) for modules in (there, here))
    region, required = [(-0.5, 0.5)] * 3, tl.Requirement(ball=1.0)
    one = certify(carried, region, required, 0.1, frames={"stand": (shift, turn)})
    other = certify(plain, region, required, 0.1)
    assert set(one.verdict) == {1, -1, 0}
    at = np.random.default_rng(6).uniform(-0.5, 0.5, (5000, 3))
    found, expected = one.at(at), other.at(at)
    assert (found * expected >= 0).all()
    assert (found == expected).mean() > 0.99  # but for cells on the edge of rounding


def test_clearance_over_pulleys_is_refused():
    rig = replace(
        SQUARE, modules=tuple(replace(each, pulley_radius=0.01, pulley_axis=[0.0, 1.0]) for each in SQUARE.modules)
    )
    with pytest.raises(InputError, match="the proof of clearance holds for fixed anchors"):
        certify(rig, [(0.0, 1.0), (0.0, 1.0)], [0.0, 0.0], 0.1, clearance=0.01)


def test_wrench_closure_of_a_published_robot():
    rig = tl.load_rig("ipanema-2")
    proved = certify(rig, [(-4, 4), (-3, 3), (2, 4)], "wrench-closure", 0.2)
    for verdict in (1, -1):
        positions = random_positions(proved, verdict, many(20_000), np.random.default_rng(4))
        assert (tl.workspace.wrench_closure(rig.structure_matrix(positions)) == (verdict == 1)).all()
    # The published counts on a grid lie between what is proved of its points.
    x, y = np.meshgrid(np.linspace(-4, 4, 81), np.linspace(-3, 3, 61))
    for z, count in ((2.0, 3591), (3.0, 3575), (4.0, 3575)):
        found = proved.at(np.stack([x, y, np.full_like(x, z)], axis=-1))
        assert (found == 1).sum() <= count <= (found >= 0).sum()
        assert (found == 0).sum() < 0.25 * found.size


@pytest.mark.parametrize("kind", ["planar-point", "point", "planar", "platform"])
def test_numpy_agrees_on_random_cells(kind):
    rng = np.random.default_rng(8)
    d, n = {"planar-point": (2, 2), "point": (3, 3), "planar": (2, 3), "platform": (3, 6)}[kind]
    seen = set()
    for _ in range(many(150, 30)):
        m = int(rng.integers(n + 1, n + 3))
        arms = None if n == d else rng.uniform(-0.3, 0.3, (m, d))
        rig = rig_of(kind, rng.uniform(-1, 1, (m, d)), arms, rng.uniform(0, 0.2), rng.uniform(1, 5))
        wrench = rig.structure_matrix(np.zeros(d)) @ rng.uniform(rig.limits.lower, rig.limits.upper)
        required = tl.Requirement(wrench=wrench, ball=rng.uniform(0, 0.2))
        problem = cell_problem(rig, required, None, 0.0, None, None)
        centre, half = rng.uniform(-0.1, 0.1, d), rng.uniform(0.002, 0.06, d)
        if np.linalg.norm(problem.anchors[0] - problem.arms[0] - centre, axis=1).min() < 0.1:
            continue
        verdict = int(problem.prove(centre[None], half, True).verdict[0])
        cell = Cell(problem, centre, half)
        inside, outside = cell.inside(), cell.outside()
        assert abs(inside) < 1e-5 or (verdict == 1) == (inside > 0)
        assert outside < 1e-5 or verdict == -1
        seen.add(verdict)
    assert seen == {1, -1, 0}


def test_a_hole_that_no_grid_would_see_is_found():
    rig, place = planar_platform_with_a_hole()
    region = np.stack([place - 0.03, place + 0.03], axis=1)
    grid = tl.workspace.box(*region, step=0.002)

    swept = required_margin(rig, rig.structure_matrix(grid.arrays()[0] + 0.0007), hole_requirement(1e-7))
    assert (swept > 0).all()  # 961 positions of a grid, all of which are feasible
    found = certify(rig, region, hole_requirement(1e-7), 1e-5)
    assert not found.proved
    hole = found.centres[found.verdict != 1]
    assert np.abs(hole - place).max() < 0.001
    assert (found.verdict == -1).any()
    assert 0 < found.region_volume - found.volume.lower < 1e-6
    assert certify(rig, region, hole_requirement(-1e-7), 1e-5).proved


def test_all_rotations_count():
    rig = tl.load_rig("kntu-planar")
    region, required = [(-1.1, 1.1), (-1.0, 1.0)], tl.Requirement(ball=3.0)
    both = certify(rig, region, required, 0.05, rotations=[-0.2, 0.3])
    each = [certify(rig, region, required, 0.05, rotations=angle) for angle in (-0.2, 0.3)]
    at = np.random.default_rng(6).uniform(*np.array(region).T, (2000, 2))
    found, one, other = (proved.at(at) for proved in (both, *each))
    assert (found[(one == -1) | (other == -1)] <= 0).all()
    assert (found[(one == 1) & (other == 1)] >= 0).all()
    assert both.volume.lower <= min(proved.volume.upper for proved in each)


def test_an_angle_covers_all_rotations_within_it():
    rig, rng = tl.load_rig("ipanema-2"), np.random.default_rng(7)
    region, required, angle = [(-4, 4), (-3, 3), (1, 5)], tl.Requirement(gravity=True, ball=2.0), 0.03
    still, turning = (certify(rig, region, required, 0.4, angle=each) for each in (0.0, angle))
    assert 0.5 * still.volume.lower < turning.volume.lower <= turning.volume.upper <= still.volume.upper + 1e-9
    positions = random_positions(turning, 1, many(20_000), rng)
    axis = rng.normal(size=(len(positions), 3))
    turns = tl.model.kinematics.exponential(angle * axis / np.linalg.norm(axis, axis=1, keepdims=True))
    margin = required_margin(rig, rig.structure_matrix(positions, turns), required, turns)
    assert (margin > 0).all()


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"region": [(0.0, 1.0), (1.0, 0.0)]}, InputError, "along y; give the lower end first"),
        ({"resolution": 0.0}, InputError, "resolution is 0.0"),
        ({"resolution": 1e-12}, InputError, "an axis of the region has"),
        ({"required": [1.0, 2.0, 3.0]}, RigError, "needs 2"),
        ({"required": "everything"}, InputError, "wrench-closure"),
        ({"rotations": 0.1}, InputError, "cannot turn"),
        ({"angle": 0.1}, InputError, "cannot turn"),
        ({"region": [(0.0, np.nan), (0.0, 1.0)]}, ShapeError, "region"),
        ({"clearance": -0.1}, InputError, "clearance"),
        ({"bodies": [tl.Body("ball", [0.0, 0.0, 0.0], radius=0.1)]}, RigError, 'body "ball" has 3'),
        ({"angle": 2.0}, InputError, "angle is 2"),
    ],
)
def test_what_does_not_fit_is_refused(arguments, error, words):
    given = {"region": [(0.0, 1.0), (0.0, 1.0)], "required": [0.0, 0.0], "resolution": 0.1} | arguments
    with pytest.raises(error, match=words):
        certify(SQUARE, **given)


def test_too_few_cables_and_bodies_in_several_places_are_refused():
    one = tl.Rig("one", "planar-point", SQUARE.modules[:1], home=[0.0, 0.0])
    with pytest.raises(InputError, match="1 cables whose tension can change; give it 2"):
        certify(one, [(0.0, 1.0), (0.0, 1.0)], [0.0, 1.0], 0.1)
    rig = tl.load_rig("body-mounted")
    frames = {name: (each.position + np.zeros((2, 3)), None) for name, each in rig.at_rest.items()}
    with pytest.raises(InputError, match="frames: give one pose for each body frame"):
        certify(rig, [(-0.1, 0.1)] * 3, tl.Requirement(ball=1.0), 0.1, frames=frames)


def test_positions_inside_a_pulley_are_outside():
    axis = [0.0, 1.0]
    modules = tuple(replace(each, pulley_radius=0.2, pulley_axis=axis) for each in SQUARE.modules)
    rig = replace(SQUARE, modules=modules)
    proved = certify(rig, [(-0.5, 1.5), (-0.5, 1.5)], ([0.5, 0.0], 0.0), 0.02)
    at = np.random.default_rng(7).uniform(-0.5, 1.5, (20_000, 2))
    apart = np.abs(at[:, None] - rig.anchors)  # the rims touch the axes, which are upright, on both sides
    from_rim = np.hypot(apart[..., 0] - 0.2, apart[..., 1]).min(axis=1) - 0.2
    assert (proved.at(at)[from_rim < 0] <= 0).all()
    assert (proved.at(at)[from_rim < -0.03] == -1).all()
