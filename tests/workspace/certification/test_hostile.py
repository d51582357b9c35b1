"""Rigs that are hard to prove anything of: nothing that is said of their cells may be wrong.

What is true is said by other code: capacity margins, the solver's own certificates and SciPy's linear programs.
"""

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.model import kinematics
from tensionlab.model.pose import rotations as matrices_of
from tensionlab.model.pulleys import route_cables
from tensionlab.workspace.wrench_set import required_margin
from tests.helpers.examples import many
from tests.helpers.reference_metrics import renders

SIZES = {"planar-point": (2, 2), "point": (3, 3), "planar": (2, 3), "platform": (3, 6)}
FLAWS = [
    "none",
    "doubled",  # cables two and three times in one place
    "tripled",
    "flat",  # all anchors in a plane
    "fixed",  # some tensions
    "anchor-within",  # the middle of the region
    "small",  # lengths of micrometres and kilometres
    "large",
    "weak",  # nano- and giganewtons
    "strong",
    "slack",  # lower limits of 0
    "pulleys",  # any way round, some with their axes through the region
    "pulley-within",
]
SCALES = {"small": (1e-6, 1.0), "large": (1e3, 1.0), "weak": (1.0, 1e-9), "strong": (1.0, 1e9)}


def hostile(kind, flaw, rng):
    """Return a random rig with a flaw, a region in its middle, and what is required."""
    d, n = SIZES[kind]
    size, strength = SCALES.get(flaw, (1.0, 1.0))
    m = int(rng.integers(n + 1, n + 4))
    anchors, arms = rng.uniform(-1, 1, (m, d)), rng.uniform(-0.3, 0.3, (m, d))
    lower, upper = rng.uniform(0.1, 0.5, m), rng.uniform(1, 5, m)
    if flaw == "doubled":
        anchors[1::2], arms[1::2] = anchors[: m - 1 : 2][: len(anchors[1::2])], arms[0]
        arms[0::2] = arms[0]
    elif flaw == "tripled":
        anchors[1:3], arms[1:3] = anchors[0], arms[0]
    elif flaw == "flat":
        anchors[:, -1] = 0.7
    elif flaw == "fixed":
        lower[n:] = upper[n:]
    elif flaw == "anchor-within":
        anchors[0] = (arms[0] if n > d else 0.0) + 0.0123  # at no corner of a cell: no cable has a direction there
    elif flaw == "slack":
        lower[:] = 0.0
    radii, axes = rng.choice([0.01, 0.05, 0.3], m), rng.normal(size=(m, d))
    axes[::2] = (anchors * rng.choice([-1.0, 1.0], (m, 1)) + 0.1 * axes)[::2]
    if flaw == "pulley-within":
        anchors[0], radii[0] = 0.0123 + (arms[0] if n > d else 0.0), 1e-4
    modules = tuple(
        tl.Module(
            str(i),
            size * anchors[i],
            strength * lower[i],
            strength * upper[i],
            **({} if n == d else {"attachment": size * arms[i]}),
            **({"pulley_radius": radii[i], "pulley_axis": axes[i]} if flaw.startswith("pulley") else {}),
        )
        for i in range(m)
    )
    rig = tl.Rig("hostile", kind, modules, home=np.zeros(d))
    at = size * rng.uniform(-0.2, 0.2, d)
    middle = matrices(rig, at) @ (strength * rng.uniform(lower, upper))
    if not np.isfinite(middle).all():
        middle = np.zeros(n)
    ball = strength * float(rng.choice([0.0, 0.02, 0.2]))
    required = tl.Requirement(wrench=middle, ball=ball, length=size * 0.3 if n > d else None)
    return rig, size * np.stack([np.full(d, -0.35), np.full(d, 0.35)], axis=1), required


def matrices(rig, at, turns=None):
    """Structure matrices at positions (..., d), NaN where an attachment is inside its pulley."""
    flat = at.reshape(-1, rig.dimension)
    R = None if rig.n == rig.dimension else np.broadcast_to(rig.home_matrix, (len(flat), *2 * [rig.dimension]))
    if turns is not None:
        R = matrices_of(turns, rig.dimension, "turns")
    sound = np.ones(len(flat), bool)
    if rig.pulleys is not None:
        vectors = kinematics.to_anchors(
            rig.anchors, flat, None if R is None else kinematics.rotate(R, rig.attachments)
        )
        sound = (route_cables(vectors, rig.pulleys).straight > 0).all(axis=1)
    found = np.full((len(flat), rig.n, rig.m), np.nan)
    found[sound] = rig.structure_matrix(flat[sound], None if turns is None else turns[sound])
    return found.reshape(*at.shape[:-1], rig.n, rig.m)


def margins(rig, at, required, turns=None):
    """Capacity margins at positions (..., d), NaN where an attachment is inside its pulley."""
    structure = matrices(rig, at, turns)
    sound = np.isfinite(structure).all(axis=(-2, -1))
    found = np.full(sound.shape, np.nan)
    found[sound] = required_margin(rig, structure[sound], required, None if turns is None else turns[sound])
    return found


def poses_in(proved, cells, count, corners, rng):
    """Random positions (k, count, d) in cells, the first of which are corners."""
    where = rng.uniform(-0.5, 0.5, (len(cells), count, proved.rig.dimension))
    where[:, :corners] = np.sign(where[:, :corners]) / 2
    return proved.centres[cells][:, None] + where * proved.edges[cells][:, None]


@pytest.mark.parametrize("flaw", FLAWS)
@pytest.mark.parametrize("kind", SIZES)
def test_nothing_said_of_a_hostile_rig_is_wrong(kind, flaw):
    rng = np.random.default_rng([list(SIZES).index(kind), FLAWS.index(flaw)])
    d, n = SIZES[kind]
    for _ in range(many(12, 2) if n < 6 else many(4, 1)):
        rig, region, required = hostile(kind, flaw, rng)
        resolution = np.ptp(region, axis=1) / (4 if n == 6 else 16)
        proved = tl.workspace.certify(rig, region, required, resolution)
        scale = float(rig.limits.upper.sum())
        for verdict in (1, -1):
            cells = np.flatnonzero(proved.verdict == verdict)
            cells = rng.choice(cells, min(len(cells), 200), replace=False)
            at = poses_in(proved, cells, 8, 2, rng).reshape(-1, d)
            if len(at):
                check(rig, required, at, verdict, scale, rng)
        undecided = np.flatnonzero(proved.verdict == 0)
        if len(undecided):
            cells = rng.choice(undecided, min(len(undecided), 100), replace=False)
            margin = margins(rig, poses_in(proved, cells, 200, 0, rng), required)
            known = np.isfinite(margin).all(axis=1)
            sure, never = proved.shares[cells].T
            for found, bound in (((margin >= 0).mean(axis=1), sure), ((margin < 0).mean(axis=1), never)):
                noise = 6 * np.sqrt(np.maximum(bound * (1 - bound), 1 / 200) / 200)
                assert (found > bound - noise)[known].all()


def check(rig, required, at, verdict, scale, rng):
    """Hold the verdict about poses against the margin, the solver's certificates and linear programs."""
    W = matrices(rig, at)
    there = np.isfinite(W).all(axis=(1, 2))
    assert there.all() or verdict == -1  # no attachment is inside its pulley
    W = W[there]
    if not len(W):
        return
    margin = required_margin(rig, W, required)
    assert (verdict * margin > -1e-9 * scale).all()
    unit = np.ones(rig.n)
    unit[rig.dimension :] = required.length_for(rig)
    away = rng.normal(size=(len(W), rig.n))
    if verdict == -1:
        for row, structure in enumerate(W):
            normals, offsets = tl.workspace.half_spaces(structure / unit[:, None], rig.limits)
            away[row] = normals[(offsets - normals @ (required.at(rig)[0] / unit)).argmin()]
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    # In units of the rig itself: a solver's tolerance is not below a part of a newton.
    wrench = (required.at(rig)[0] / unit + required.ball * away) / scale
    lower, upper, W = rig.limits.lower / scale, rig.limits.upper / scale, W / unit[:, None]
    clear = np.abs(margin) > 1e-5 * scale
    status = tl.allocate(W, wrench, (lower, upper)).status
    assert not (status[clear] == (tl.Status.NEAREST if verdict == 1 else tl.Status.EXACT)).any()
    for row in rng.choice(np.flatnonzero(clear), min(3, clear.sum())):
        assert renders(W[row], lower, upper, wrench[row]) == (verdict == 1)


def test_nothing_is_said_of_lengths_whose_squares_are_lost():
    corners = 1e-160 * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    modules = tuple(tl.Module(str(i), corner, 0.1, 1.0) for i, corner in enumerate(corners))
    rig = tl.Rig("tiny", "planar-point", modules, home=corners.mean(axis=0))
    proved = tl.workspace.certify(rig, [(-1e-160, 2e-160)] * 2, ([0.0, 0.0], 0.1), 1e-161)
    assert not proved.verdict.any()


@pytest.mark.parametrize("flaw", FLAWS)
@pytest.mark.parametrize("kind", ["planar", "platform"])
def test_what_is_inside_is_so_within_an_angle_of_each_rotation(kind, flaw):
    rng = np.random.default_rng([7, FLAWS.index(flaw)])
    for _ in range(many(12, 2) if kind == "planar" else many(4, 1)):
        rig, region, required = hostile(kind, flaw, rng)
        angle = float(rng.choice([0.01, 0.05]))
        rotations = np.array([0.1, -0.15])
        if kind == "platform":
            rotations = tl.model.kinematics.exponential(rotations[:, None] * [0.6, 0.0, 0.8])
        resolution = np.ptp(region, axis=1) / (16 if kind == "planar" else 4)
        proved = tl.workspace.certify(rig, region, required, resolution, rotations=rotations, angle=angle)
        cells = np.flatnonzero(proved.verdict == 1)
        at = poses_in(proved, cells[:200], 8, 2, rng).reshape(-1, rig.dimension)
        for rotation in rotations:
            if kind == "planar":
                turns = rotation + rng.choice([-angle, 0.0, angle], len(at))
            else:
                axis = rng.normal(size=(len(at), 3))
                axis *= angle / np.linalg.norm(axis, axis=1, keepdims=True)
                turns = tl.model.kinematics.exponential(axis) @ rotation
            margin = margins(rig, at, required, turns)
            assert (margin > -1e-9 * float(rig.limits.upper.sum())).all()
