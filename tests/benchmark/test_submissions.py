"""Submissions to the leaderboard: nothing in them is believed, and what is damaged is refused by its place."""

import runpy
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import tensionlab as tl
from benchmarks import submit
from tensionlab.benchmark.baselines import BASELINES
from tensionlab.benchmark.entries import driver, entries
from tensionlab.benchmark.optimum import distance_bound, optimum
from tensionlab.benchmark.problem_sets import problem_of
from tensionlab.benchmark.submissions import LARGEST, MERITS, leaderboard, read_submissions, times, to_markdown
from tensionlab.errors import DataError
from tests.helpers.shown import differences

ROOT = Path(__file__).parents[2]
COMMITTED = ROOT / "benchmarks" / "submissions"
SCORES = [*MERITS, *LARGEST, "median_s"]
TRACKS = [name.partition("/")[2] for name in tl.datasets.names("tracks")]


@pytest.fixture(scope="module")
def committed():
    return read_submissions(COMMITTED)


@pytest.fixture
def mine(tmp_path):
    """A copy of a submission."""
    return Path(shutil.copytree(COMMITTED / "newton", tmp_path / "mine"))


def change(file, **changed):
    """Save an NPZ file with some arrays changed."""
    np.savez(file, **(dict(np.load(file)) | changed))


def score_of(folder):
    """Its score on the first track."""
    return read_submissions(folder)[SCORES].iloc[0]


@pytest.mark.parametrize("name", TRACKS)
def test_the_optima_of_a_track_are_proved_far_below_the_smallest_tolerance(name):
    (group,) = tl.datasets.load(f"tracks/{name}").groups
    problem = problem_of(group, "force")
    best = optimum(problem)
    scale = np.maximum(1.0, np.linalg.norm(problem.wrench, axis=1))
    assert best.verified.all()
    assert (distance_bound(problem, best.tensions) <= 1e-10 * scale).all()
    assert (group.previous < np.arange(len(problem))).all()


def test_the_tracks_are_generated_by_one_command(tmp_path):
    program = runpy.run_path(str(ROOT / "datasets" / "tracks" / "make.py"))
    program["main"].__globals__["FOLDER"] = tmp_path
    program["main"]()
    assert sorted(path.stem for path in tmp_path.iterdir()) == TRACKS
    for path in tmp_path.iterdir():
        kept = np.load(ROOT / "datasets" / "tracks" / path.name)
        for key, values in np.load(path).items():
            np.testing.assert_allclose(values, kept[key], rtol=1e-9, atol=1e-12)


def test_the_committed_leaderboard_is_that_of_the_committed_answers(committed):
    shown = (COMMITTED / "README.md").read_text(encoding="utf-8")
    assert not differences(shown, to_markdown(committed)), "run `make generated`"


def test_it_starts_with_ours_and_all_baselines_and_is_small(committed):
    solvers = {name.partition(",")[0] for name in committed["solver"]}
    assert {"newton", "dykstra", "closed-form", *BASELINES} <= solvers
    assert {"Python", "C"} <= set(committed["language"])
    assert (committed[committed["solver"] == "newton"]["optimal_1e9"] == 1.0).all()
    files = [path for folder in (COMMITTED, ROOT / "datasets" / "tracks") for path in folder.rglob("*.*")]
    assert sum(path.stat().st_size for path in files) < 300_000


def test_a_solver_that_jumps_is_seen_to(committed):
    jumps = committed.groupby("submission")["jump"].max()
    assert jumps["newton"] < 1e-3
    assert jumps["minimax"] > 0.5
    assert jumps["least-sum"] > 0.5


@pytest.mark.parametrize("name", ["newton", "daqp"])
def test_a_submission_can_be_replayed(name, monkeypatch):
    monkeypatch.setattr(submit, "REPEATS", 1)
    runs = driver(entries("all", [name])[-1])
    for track in ("edge-1", "warm-1"):
        (group,) = tl.datasets.load(f"tracks/{track}").groups
        tensions, _ = submit.answers(runs, problem_of(group, "force"))
        kept = np.load(COMMITTED / name / f"{track}.npz")["tensions"]
        np.testing.assert_allclose(tensions, kept, atol=1e-8)


def test_answers_are_measured_and_not_believed(mine):
    file = mine / "edge-1.npz"
    tensions = np.load(file)["tensions"]
    upper = np.load(ROOT / "datasets" / "tracks" / "edge-1.npz")["upper"]
    assert score_of(mine).optimal_1e9 == 1.0
    changed = tensions.copy()
    changed[:10] = 3.0  # renders another wrench
    changed[10:20] = np.nan  # no answer
    changed[20] = np.where(changed[20] == upper[20], changed[20] + 1e-4, changed[20])
    change(file, tensions=changed)
    score = score_of(mine)
    assert score.optimal_1e6 == score.rendered == 0.475
    assert score.violation_max == pytest.approx(1e-4)
    change(file, tensions=np.clip(tensions + 1e-7, None, upper))
    score = score_of(mine)
    assert (score.optimal_1e6, score.optimal_1e9, score.violation_max) == (1.0, 0.0, 0.0)


def test_a_track_left_out_counts_as_unsolved(mine):
    for track in TRACKS[1:]:
        (mine / f"{track}.npz").unlink()
    change(mine / f"{TRACKS[0]}.npz", times_s=np.full(40, np.nan))
    found = read_submissions(mine)
    assert list(found["optimal_1e6"]) == [1.0] + 5 * [0.0]
    assert times(found) == []
    assert leaderboard(found).rows[0][:4] == [1, "mine", "Python", 1.0]


def test_parquet_is_as_good_as_npz(mine):
    expected = score_of(mine)
    arrays = np.load(mine / "edge-1.npz")
    columns = {"tensions": list(arrays["tensions"]), "times_s": arrays["times_s"]}
    pq.write_table(pa.table(columns), mine / "edge-1.parquet")
    with pytest.raises(DataError, match=r"edge-1\.parquet: the track is there twice; keep"):
        read_submissions(mine)
    (mine / "edge-1.npz").unlink()
    pd.testing.assert_series_equal(score_of(mine), expected)
    pq.write_table(pa.table({"tensions": [[1.0], [1.0, 2.0]]}), mine / "edge-1.parquet")
    with pytest.raises(
        DataError, match=r"edge-1\.parquet: give numbers in times_s, and in tensions lists of one length"
    ):
        read_submissions(mine)


def at(index, value, shape=(40, 8)):
    values = np.ones(shape)
    values[index] = value
    return values


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"tensions": np.ones((40, 7))}, r"edge-1\.npz: tensions has shape \(40, 7\); the track has \(40, 8\)"),
        ({"tensions": at((3, 2), np.inf)}, r"edge-1\.npz: tensions\[3, 2\] is inf; give newtons, or a row of NaN"),
        ({"tensions": at((3, 2), np.nan)}, r"tensions\[3, 2\] is nan"),
        ({"times_s": at(5, -1.0, 40)}, r"times_s\[5\] is -1; give seconds above 0"),
        ({"times_s": np.ones(3)}, r"times_s has shape \(3,\); the track has \(40,\)"),
        ({"status": np.ones(40)}, r'unknown column "status"; there may be tensions, times_s'),
    ],
)
def test_damaged_answers_are_refused_by_file_array_and_entry(mine, changed, message):
    change(mine / "edge-1.npz", **changed)
    with pytest.raises(DataError, match=message):
        read_submissions(mine)


def test_a_folder_that_is_no_submission_is_refused(mine, tmp_path):
    shutil.copy(mine / "edge-1.npz", mine / "edgy-1.npz")
    with pytest.raises(DataError, match=r"edgy-1\.npz: no track is called 'edgy-1'; did you mean 'edge-1'"):
        read_submissions(mine)
    for file in mine.glob("*.npz"):
        file.unlink()
    with pytest.raises(DataError, match="mine: answers to no track; give a submission: a folder with submission"):
        read_submissions(mine)
    about = mine / "submission.toml"
    about.write_text(about.read_text(encoding="utf-8").replace("machine", "computer"), encoding="utf-8")
    with pytest.raises(DataError, match=r"machine is missing(.|\n)*computer is an unk"):
        read_submissions(mine)
    about.unlink()
    with pytest.raises(DataError, match=r"no submission\.toml in it or in a folder of it; give a submission"):
        read_submissions(tmp_path)
