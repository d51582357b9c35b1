"""`examples/study`: the staircase recovers known thresholds, alone and through the bridge."""

import csv
import importlib
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.optimize import brentq

from benchmarks.processes import process

FOLDER = Path(__file__).parents[1] / "examples" / "study"
STANDARD_N = 2.0
SUBJECTS, TRIALS = 200, 80


@pytest.fixture(scope="module")
def study():
    """The module of the staircase, imported as the example imports it."""
    sys.path.insert(0, str(FOLDER))
    yield importlib.import_module("staircase")
    sys.path.remove(str(FOLDER))


def answered(study, threshold, seed, trials=TRIALS):
    """A staircase with the answers of a simulated subject."""
    rng = np.random.default_rng([seed, round(10 * threshold)])
    subject, staircase = study.Subject(threshold, STANDARD_N, rng), study.Staircase()
    for _ in range(trials):
        comparison = STANDARD_N * (1.0 + staircase.level / 100.0)
        second = bool(rng.integers(2))
        felt = (STANDARD_N, comparison) if second else (comparison, STANDARD_N)
        staircase.answer(subject.choose(*felt) == 1 + second)
    return staircase


def test_a_subject_is_right_three_times_in_four_at_its_threshold(study):
    subject = study.Subject(10.0, STANDARD_N, np.random.default_rng(1))
    right = np.mean([subject.choose(STANDARD_N, 1.1 * STANDARD_N) == 2 for _ in range(40_000)])
    expected = study.LAPSES / 2 + (1.0 - study.LAPSES) * 0.75
    assert right == pytest.approx(expected, abs=4.0 * np.sqrt(expected * (1.0 - expected) / 40_000))
    assert study.proportion_correct(10.0, 10.0) == pytest.approx(expected)


@pytest.mark.parametrize("threshold", [5.0, 10.0, 20.0])
def test_intervals_contain_the_thresholds_of_nineteen_subjects_in_twenty(study, threshold):
    """Coverage of 200 subjects: 95 % is 190, and 181 to 199 are within three standard deviations of that."""
    found = [answered(study, threshold, seed) for seed in range(SUBJECTS)]
    fits = [study.fit_threshold(each.levels, each.correct) for each in found]
    covered = sum(each.low <= threshold <= each.high for each in fits)
    print(f"{threshold:g} %: {covered} of {SUBJECTS}")
    assert 181 <= covered <= 199
    assert np.exp(np.mean(np.log([each.value for each in fits]))) == pytest.approx(threshold, rel=0.07)
    reversals = [each.mean_of_reversals() for each in found]
    assert np.exp(np.mean(np.log(reversals))) == pytest.approx(threshold, rel=0.1)
    # More trials tell more: half the width of the interval, on a logarithmic scale, for four times as many.
    longer = study.fit_threshold(*(4 * part for part in (found[0].levels, found[0].correct)))
    ratio = np.log(fits[0].high / fits[0].low) / np.log(longer.high / longer.low)
    assert ratio == pytest.approx(2.0, rel=0.25)


def test_the_staircase_balances_where_three_answers_in_four_are_right(study):
    """A step up is three steps down, so that a share of 75 % right leaves the level where it is."""
    staircase = study.Staircase(level=10.0, steps=(1.1, 1.1))
    for correct in (True, True, True, False, True, True, False, True):
        staircase.answer(correct)
    assert staircase.level == pytest.approx(10.0)
    assert staircase.reversals == [3, 4, 6, 7]
    for _ in range(100):
        staircase.answer(True)
    assert staircase.level == staircase.smallest
    for _ in range(100):
        staircase.answer(False)
    assert staircase.level == staircase.largest


def test_the_fit_is_where_the_likelihood_is_largest_with_many_answers(study):
    """With a level only and 10,000 answers, the threshold is where the model has the observed share."""
    correct = [True] * 7_000 + [False] * 3_000
    fit = study.fit_threshold([8.0] * 10_000, correct)
    exact = brentq(lambda threshold: study.proportion_correct(8.0, threshold) - 0.7, 1.0, 100.0)
    assert fit.value == pytest.approx(exact, rel=0.01)
    assert fit.low < exact < fit.high < 1.12 * fit.low


@pytest.mark.realtime  # two processes, a bridge between them
def test_it_recovers_a_threshold_through_the_bridge(tmp_path, study):
    out, count = tmp_path / "participant", 24
    with process("serve", "bartels2026-validation", "--port", "0") as running:
        url = running.stdout.readline().split("/command")[0]
        words = f"--out {out} --subject 10 --trials {count} --hold 0.21 --pause 0.02 --seed 5".split()
        words = [sys.executable, FOLDER / "discrimination.py", url, *words]
        done = subprocess.run(words, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    assert re.search(rf"^{count} trials, \d+ reversals; threshold \d+\.\d % of 2 N, 95 % interval", done.stdout)
    rows = list(csv.DictReader((out / "trials.csv").read_text().splitlines()))
    levels, correct = [float(row["level_percent"]) for row in rows], [row["correct"] == "True" for row in rows]
    fit = study.fit_threshold(levels, correct)
    assert fit.low <= 10.0 <= fit.high
    felt, desired = ([[float(row[f"{what}_{interval}_n"]) for interval in "12"] for row in rows]
                     for what in ("felt", "desired"))  # fmt: skip
    # A busy machine may be late in an interval, or measure nothing in it, but not in all.
    assert np.isnan(felt).mean() < 0.1
    assert np.nanmedian(np.abs(np.array(felt) / np.array(desired) - 1.0)) < 0.01
    for row in rows:
        heavier = 2 if row["first"] == "standard" else 1
        assert (int(row["answer"]) == heavier) == (row["correct"] == "True")
    stored = pq.read_table(out / "trials.parquet")
    assert stored.num_rows == count
    about = json.loads(stored.schema.metadata[b"tensionlab"])
    assert about["threshold"] == pytest.approx(list(fit))
    markers = list(csv.DictReader((out / "markers.csv").read_text().splitlines()))
    assert len(markers) == 3 * count + 1
    assert markers[-1]["text"] == f"ended: {count} trials"
    times = [float(marker["run_time_s"]) for marker in markers]
    assert times == sorted(times)
    assert (out / "staircase.png").stat().st_size > 10_000
