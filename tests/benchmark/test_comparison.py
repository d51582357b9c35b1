import dataclasses
import itertools
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.benchmark.comparison import MAX_TIMED_CALLS, compare, merge_policies
from tensionlab.errors import InputError, ShapeError
from tensionlab.workspace.poses import read_poses

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"
QUICK = ["newton", "dykstra", "pseudoinverse:middle", "closed-form", "qp:daqp"]


def quickly_compared(name):
    """Compare some solvers on a rig, and time only 20 calls of each."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tensionlab.benchmark.comparison.MAX_TIMED_CALLS", 20)
        return compare(tl.load_rig(RIGS / f"{name}.toml"), solvers=QUICK)


@pytest.fixture(scope="module")
def published():
    return quickly_compared("bartels2026-validation")


@pytest.fixture(scope="module")
def narrow():
    return quickly_compared("bartels2026-validation-0.3m")


def rows_of(comparison):
    return {(row.solver, row.policy): row for row in comparison.rows}


def test_on_the_published_rig_the_complete_solvers_render_all_182_and_agree(published):
    assert published.wrenches.shape == (182, 3)
    np.testing.assert_allclose(np.linalg.norm(published.wrenches, axis=1), 1.5)
    rows = rows_of(published)
    for (solver, _), row in rows.items():
        if solver in ("newton", "dykstra", "qp:daqp"):
            assert (row.exact, row.nearest_count, row.unproven, row.failed) == (182, 0, 0, 0)
            assert row.gap_max < 1e-5
            assert row.residual_max < 1e-6
            assert row.angle_max_deg < 1e-4
    assert len([solver for solver, _ in rows if solver == "newton"]) == 3


def test_on_the_narrow_rig_29_are_infeasible_with_the_published_errors(narrow):
    rows = rows_of(narrow)
    for solver in ("newton", "qp:daqp"):
        for policy, angle, residual in (
            ("force", 1.6, 0.20),
            ("tension", 10.7, 0.32),
            ("direction", 0.0, 0.20),
        ):
            row = rows[solver, policy]
            assert (row.exact, row.nearest_count, row.unproven, row.failed) == (153, 29, 0, 0)
            assert row.angle_max_deg == pytest.approx(angle, abs=0.05)
            assert row.residual_max == pytest.approx(residual, abs=0.005)
            assert row.gap_max < 1e-5


def test_policies_are_one_row_where_all_is_feasible_and_only_there(published, narrow):
    shown = [(row.solver, row.policy) for row in merge_policies(published.rows)]
    assert len(shown) == len({solver for solver, _ in shown})
    assert ("newton", "any") in shown
    assert ("dykstra", "tension") in shown, "one policy stays what it is"
    assert merge_policies(narrow.rows) == list(narrow.rows)
    assert "any" not in {row.policy for row in published.rows}, "the rows themselves stay"
    pair = [row for row in published.rows if row.solver == "newton"][:2]
    for counts in itertools.product((0, 1), repeat=3):
        changed = dict(zip(("nearest_count", "unproven", "failed"), counts, strict=True))
        rows = [dataclasses.replace(row, **changed) for row in pair]
        assert len(merge_policies(rows)) == (2 if any(counts) else 1)


def test_a_title_says_what_was_rendered(published, along):
    name = "bartels2026-validation, 4 modules: "
    assert published.title == f"{name}182 forces of 1.5 N at (0, 0.3, 0) m"
    assert dataclasses.replace(published, magnitude=None).title == f"{name}182 required wrenches at (0, 0.3, 0) m"
    assert along.title.endswith(f": {len(along.wrenches)} samples of a trajectory")


def test_without_a_policy_the_gap_counts_only_what_is_feasible(narrow):
    reachable = narrow.allocations[0].status == tl.Status.EXACT
    column = [row.solver for row in narrow.rows].index("closed-form")
    difference = np.abs(narrow.allocations[column].tensions - narrow.allocations[0].tensions)
    row = narrow.rows[column]
    assert (row.policy, row.nearest_count) == (None, 0)
    assert row.exact + row.unproven == 182
    assert row.gap_max == difference[reachable].max()


def test_the_numbers_of_a_row_follow_from_its_allocation(narrow):
    for row, found in zip(narrow.rows, narrow.allocations, strict=True):
        error = np.linalg.norm(narrow.wrenches - found.tensions @ narrow.structure.T, axis=1)
        assert row.residual_mean == pytest.approx(error.mean(), abs=1e-12)
        assert row.residual_max == pytest.approx(error.max(), abs=1e-12)
        assert row.tension_sq_mean == pytest.approx(np.mean(found.tensions**2))
        cosine = np.einsum("ki,ki->k", narrow.wrenches, found.wrench) / (
            1.5 * np.linalg.norm(found.wrench, axis=1)
        )
        assert row.angle_mean_deg == pytest.approx(np.degrees(np.arccos(cosine.clip(-1, 1))).mean(), abs=1e-5)


def test_a_slow_moment_of_the_machine_changes_no_time(monkeypatch):
    looks = itertools.count()

    def perf_counter():
        """A clock on which everything takes 1 ms, but for 30 ms before the fourth look at it."""
        look = next(looks)
        return 0.001 * look + 0.03 * (look >= 3)

    monkeypatch.setattr("tensionlab.benchmark.speed.time", SimpleNamespace(perf_counter=perf_counter))
    rig = tl.load_rig(RIGS / "bartels2026-validation.toml")
    for row in compare(rig, solvers=["closed-form", "pseudoinverse"]).rows:
        assert row.batch_s == pytest.approx(0.001 / 182)
        assert row.call_median_s == pytest.approx(0.001)


def test_position_and_magnitude_and_directions_are_used():
    rig = tl.load_rig(RIGS / "bartels2026-validation.toml")
    at, up = [0.0, 0.5, 0.1], [[0.0, 1.0, 0.0]]
    result = compare(rig, position=at, directions=up, magnitude=2.0, solvers=["newton"], policy="tension")
    np.testing.assert_array_equal(result.wrenches, [[0.0, 2.0, 0.0]])
    np.testing.assert_allclose(result.structure, rig.structure_matrix([0.0, 0.5, 0.1]))
    assert [(row.solver, row.policy) for row in result.rows] == [("newton", "tension")]


@pytest.mark.parametrize(("name", "count", "forces"), [("kntu-planar", 72, 2), ("ipanema-1", 182, 3)])
def test_a_platform_is_pulled_without_torque(name, count, forces):
    result = compare(tl.load_rig(name), magnitude=5.0, solvers=["newton"], policy="force")
    assert len(result.wrenches) == count
    np.testing.assert_allclose(np.linalg.norm(result.wrenches[:, :forces], axis=1), 5.0)
    assert not result.wrenches[:, forces:].any()


def test_an_instance_is_compared_beside_names():
    result = tl.compare(
        tl.load_rig("bartels2026-validation-0.3m"), solvers=[tl.solvers.Dykstra(iteration_limit=2), "newton"]
    )
    rows = rows_of(result)
    cut_short, exact = rows["dykstra(iteration_limit=2)", "tension"], rows["newton", "tension"]
    assert exact.exact == 153
    assert cut_short.exact < 153
    assert cut_short.residual_max > exact.residual_max


def test_progress_grows_to_one():
    shares = []
    rig = tl.load_rig(RIGS / "bartels2026-validation.toml")
    compare(rig, solvers=["newton"], progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)
    assert len(shares) > 10


def test_a_large_set_is_solved_whole_and_timed_in_part(monkeypatch):
    calls = []
    plain = tl.Allocator.__call__
    monkeypatch.setattr(
        tl.Allocator, "__call__", lambda self, *a: (calls.append(np.ndim(a[1])), plain(self, *a))[1]
    )
    rig = tl.load_rig(RIGS / "bartels2026-validation.toml")
    vectors = np.tile([[1.0, 0.0, 0.0]], (1000, 1))
    result = compare(rig, directions=vectors, solvers=["newton"], policy="force")
    assert result.rows[0].exact == 1000
    assert MAX_TIMED_CALLS <= calls.count(1) <= 1.2 * MAX_TIMED_CALLS


@dataclasses.dataclass(frozen=True)
class BreaksUpwards:
    """Solver that has not thought of forces upwards."""

    objective = "none"
    policies = ()

    def solve(self, problem):
        if (problem.wrench[:, 1] > 0).any():
            raise ZeroDivisionError("no way up")
        return tl.solvers.Newton().solve(dataclasses.replace(problem, policy="force"))


def test_where_a_solver_raises_an_exception_only_that_force_fails_and_the_reason_is_kept():
    rig = tl.load_rig("bartels2026-validation")
    forces = [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]
    found = compare(rig, directions=forces, solvers=[BreaksUpwards(), "newton"])
    broken, newton = found.rows[0], found.rows[1]
    assert (broken.exact, broken.failed) == (2, 1)
    assert (newton.exact, newton.failed) == (3, 0)
    reason = found.failures["BreaksUpwards"]
    assert reason.startswith("at 1 of 3: ZeroDivisionError: no way up (test_comparison.py:")
    assert reason in found._repr_html_()


@pytest.fixture(scope="module")
def along():
    """Comparison along a straight path that leaves the workspace."""
    rig = tl.load_rig("bartels2026-validation-0.3m")
    path = rig.home + np.linspace(0.0, 0.3, 50)[:, None] * [1.0, 0.0, 0.0]
    return tl.compare(rig, [0.0, 0.0, 1.0], poses=path, solvers=["newton", "closed-form"])


def test_each_sample_of_a_trajectory_has_its_own_pose(along):
    assert along.structure.shape == (50, 3, 4)
    for found in along.allocations:
        rendered = np.einsum("knm,km->kn", along.structure, found.tensions)
        np.testing.assert_allclose(found.wrench, rendered, atol=1e-12)
    newton = along.allocations[0]
    single = along.rig.allocate([0.0, 0.0, 1.0], along.position[7])
    np.testing.assert_allclose(newton.tensions[7], single.tensions, atol=1e-9)
    row = along.rows[0]
    assert 0 < row.exact < 50
    feasible = newton.tensions[newton.exact]
    assert (row.jump, row.step_max) == (0.0, abs(np.diff(feasible, axis=0)).max())
    assert row.call_median_s > 0.0


def test_the_long_table_has_a_row_for_each_solver_policy_problem_and_quantity(along):
    table = along.to_pandas()
    keys = ["solver", "policy", "problem", "quantity"]
    assert list(table) == [*keys, "value"]
    assert len(table) == len(along.rows) * 50 * (4 + along.rig.m)
    assert not table.duplicated(keys).any()
    worst = table[table["quantity"] == "residual"].groupby(["solver", "policy"], dropna=False)["value"].max()
    assert worst["newton", "force"] == along.rows[0].residual_max
    tension = table[(table["quantity"] == "tension.top") & (table["solver"] == "closed-form")]["value"]
    np.testing.assert_array_equal(tension, along.allocations[3].tensions[:, -1])


def test_wrenches_alone_are_a_trajectory_at_home_added_to_what_is_required():
    rig = tl.load_rig("cogiro")
    rig = dataclasses.replace(rig, required=tl.Requirement(gravity=True))
    forces = np.linspace(0.0, 100.0, 20)[:, None] * [1.0, 0.0, 0.0]
    found = compare(rig, forces, solvers=["newton"], policy="force")
    weight = rig.required.middle(rig)
    np.testing.assert_allclose(found.wrenches[:, :3], forces + weight[:3])
    np.testing.assert_allclose(found.wrenches[:, 3:], np.broadcast_to(weight[3:], (20, 3)))
    np.testing.assert_array_equal(found.position, np.tile(rig.home, (20, 1)))


def test_forces_are_as_large_as_the_weight_of_the_platform_if_there_is_one():
    assert compare(tl.load_rig("cogiro"), solvers=["newton"]).magnitude == pytest.approx(91.058 * 9.81)
    assert compare(tl.load_rig("ipanema-1"), solvers=["newton"], magnitude=3.0).magnitude == 3.0


@pytest.mark.parametrize(
    ("name", "columns", "n"),
    [("kntu-planar", "x,y,angle,Fx,Fy,Mz", 3), ("cogiro", "x,y,z,Fx,Fy,Fz,Mx,My,Mz", 6)],
)
def test_torques_of_a_trajectory_are_read_and_compared(tmp_path, name, columns, n):
    rig, names = tl.load_rig(name), columns.split(",")
    values = [*rig.home, *np.arange(len(names) - rig.dimension) / 10]
    (tmp_path / "path.csv").write_text(f"{columns}\n{','.join(map(str, values))}\n")
    poses = read_poses(tmp_path / "path.csv")
    np.testing.assert_array_equal(poses.wrench, [values[-n:]])
    found = compare(rig, poses=poses, solvers=["newton"])
    np.testing.assert_allclose(found.wrenches - rig.required.middle(rig, poses.rotation), poses.wrench)


@pytest.mark.parametrize("name", ["kntu-planar", "cogiro"])
def test_along_a_trajectory_the_wrenches_are_those_of_its_dynamics_and_nothing_else(name):
    rig = tl.load_rig(name)
    lift = tl.Trajectory.through([rig.home, rig.home + 0.1], [0.0, 0.5], step=0.05)
    moving = tl.inverse_dynamics(rig, lift)
    alone, given = (compare(rig, wrench, poses=lift, solvers=["newton"]) for wrench in (None, moving))
    for found in (alone, given):
        np.testing.assert_array_equal(found.wrenches, moving)
        np.testing.assert_array_equal(found.times, lift.times)
    batch = tl.allocate(rig.structure_matrix(lift.position), moving, rig.limits)
    np.testing.assert_array_equal(batch.tensions, alone.allocations[0].tensions)


@pytest.mark.parametrize(
    ("words", "match"),
    [
        ({"wrenches": np.zeros((2, 2, 3))}, r"give \(K, 3\)"),
        ({"wrenches": np.zeros((3, 3)), "poses": np.zeros((2, 3))}, "3 wrenches for 2 poses"),
        ({"wrenches": np.zeros((3, 2))}, r"give \(K, 3\)"),
        ({"wrenches": np.zeros((3, 3)), "magnitude": 1.0}, "leave out directions and magnitude"),
        ({"poses": np.zeros((2, 3)), "position": np.zeros(3)}, "leave one out"),
        *(({"magnitude": magnitude}, "magnitude") for magnitude in (0.0, -1.0, np.nan, np.inf)),
        ({"directions": "everywhere"}, "fibonacci:N"),
    ],
)
def test_what_cannot_be_compared_is_refused(words, match):
    with pytest.raises((InputError, ShapeError), match=match):
        compare(tl.load_rig("bartels2026-validation"), solvers=["newton"], **words)
