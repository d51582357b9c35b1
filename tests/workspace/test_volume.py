import numpy as np
import pytest

import tensionlab as tl
from tensionlab.viewer.workspace import Volume
from tensionlab.workspace import Objective
from tensionlab.workspace.shares import describe_step, node_weights, weighted_share


@pytest.mark.parametrize(("nodes", "within"), [(9, 0.04), (17, 0.012), (33, 0.004)])
def test_a_sphere_that_touches_all_faces_has_its_share_of_the_box(nodes, within):
    axes = [np.linspace(-1.0, 1.0, nodes)] * 3
    inside = sum(axis**2 for axis in np.meshgrid(*axes)) < 0.999
    assert weighted_share(inside, [node_weights(axis) for axis in axes]) == pytest.approx(np.pi / 6, abs=within)


def test_nodes_stand_for_what_is_nearest_to_them_however_they_lie():
    np.testing.assert_allclose(node_weights(np.array([0.0, 1.0, 4.0])), [0.125, 0.5, 0.375])
    np.testing.assert_allclose(node_weights(np.array([4.0, 0.0, 1.0])), [0.375, 0.125, 0.5])
    np.testing.assert_allclose(node_weights(np.array([2.0])), [1.0])


def test_the_step_is_said():
    assert describe_step([np.linspace(0, 1, 11), np.linspace(0, 2, 21), np.zeros(1)]) == "0.1 m apart"
    assert describe_step([np.linspace(0, 1, 11), np.linspace(0, 2, 11)]) == "0.1 x 0.2 m apart"


def test_every_share_of_a_workspace_is_within_what_is_proved():
    """Of a sweep, of the page and of a layout's objective: all but the faces of the box is inside."""
    rig, force = tl.load_rig("kntu-planar"), 5.0
    box = [[-1.1, 1.1], [-1.0, 1.0]]
    proved = tl.workspace.certify(rig, box, tl.Requirement(ball=force), 0.01).share
    grid = tl.workspace.box(*box, step=0.02)
    swept = tl.sweep(rig, grid, f"capacity-margin:{force}")
    margins = swept[f"capacity-margin:{force}"].to_numpy()[0]
    shares = [
        tl.workspace.summary(swept)["above_zero"][0],
        Volume((grid.x, grid.y), margins).share(0.0),
        float(Objective(force).over((grid,)).score(margins.ravel() + force)),
    ]
    assert shares == pytest.approx([np.mean(proved)] * 3, abs=0.002)


@pytest.mark.parametrize("name", tl.datasets.names("rigs"))
def test_the_share_of_every_rig_is_within_what_is_proved_and_the_error_of_its_grid(name):
    """The error is half of what the border passes through: cells of the grid whose corners differ."""
    rig = tl.datasets.load(name)
    points = np.array([rig.home, *rig.anchors])
    region = np.stack([points.min(axis=0), points.max(axis=0)], axis=1)
    step = np.ptp(region, axis=1).max() / 24
    metric, required = ("wrench-feasible", None) if rig.required else ("wrench-closure", "wrench-closure")
    swept = tl.sweep(rig, tl.workspace.box(*region, step=step), metric, frames=rig.at_rest)
    share = tl.workspace.summary(swept)["above_zero"].item()
    low = high = swept[metric].to_numpy()[0] > 0
    for axis in range(rig.dimension):
        if (count := low.shape[axis]) > 1:
            pairs = np.stack([np.arange(count - 1), np.arange(1, count)])
            low, high = low.take(pairs, axis).all(axis=axis), high.take(pairs, axis).any(axis=axis)
    proved = tl.workspace.certify(rig, region, required, step, bodies=(), frames=rig.at_rest).share
    error = (high & ~low).mean() / 2
    assert proved.lower - error <= share <= proved.upper + error
