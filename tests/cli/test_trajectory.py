"""``tensionlab trajectory``: what it finds along a trajectory, and its exit status."""

import json

PROGRAM = """
points = [
  {time_s = 0.0, position = [0.0, 0.0, 1.5]},
  {time_s = 1.5, position = [2.0, 0.0, 1.5]},
  {time_s = 3.0, position = [2.0, 1.0, 2.0]},
]
"""


def test_a_trajectory_is_checked_and_solvers_are_compared_and_drawn_along_it(run, tmp_path):
    (tmp_path / "path.toml").write_text(PROGRAM)
    plot = tmp_path / "tensions.png"
    code, out, _ = run("trajectory", "cogiro", tmp_path / "path.toml", "--payload", 100, "--plot", plot)
    assert code == 0
    assert "cogiro can carry its platform along path.toml: Trajectory of 301 samples" in out
    assert "feasible at all 301 samples, at least 507 N from the edge" in out
    assert "closed-form" in out
    assert plot.stat().st_size > 1000
    code, out, _ = run("trajectory", "cogiro", tmp_path / "path.toml", "--payload", 2000, "--json")
    result = json.loads(out)
    assert code == 1
    assert not result["passed"]
    assert result["checks"][0]["finding"].startswith("infeasible at ")
    assert len(result["winches"]) == 8


def test_what_does_not_suit_is_refused(run, tmp_path):
    (tmp_path / "path.toml").write_text(PROGRAM)
    (tmp_path / "no.csv").write_text("x,y\n0,0\n")
    for words, reason in (
        (("kntu-planar", tmp_path / "path.toml"), "the trajectory has 3 coordinates; kntu-planar needs 2"),
        (("cube-8", tmp_path / "path.toml"), "[platform] is missing; give its mass"),
        (("cogiro", tmp_path / "no.csv"), 'no.csv: column "t" is missing'),
    ):
        code, _, err = run("trajectory", *words)
        assert code == 2
        assert reason in err
