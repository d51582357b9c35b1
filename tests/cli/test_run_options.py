"""Numbers that no run can go by are refused before anything is done, with the option's name."""

import pytest

RIG = "datasets/rigs/bartels2026-validation.toml"
WRONG = ("-1", "0", "nan", "inf")


@pytest.mark.parametrize("value", WRONG)
@pytest.mark.parametrize(
    "words",
    [
        ("run", RIG, "--seconds"),
        ("run", RIG, "--rate"),
        ("run", RIG, "--ttl"),
        ("serve", RIG, "--seconds"),
        ("serve", RIG, "--rate"),
        ("serve", "--scenario", "bow", "--rate"),
        ("scenario", "bow", "--seconds"),
        ("simulate", RIG, "--speed"),
    ],
)
def test_no_number_above_nought(run, words, value):
    status, out, err = run(*words, value)
    assert (status, out) == (2, "")
    assert words[-1] in err
    assert f"got {float(value):g}" in err


@pytest.mark.parametrize("option", ["--latency-ms", "--jitter-ms", "--drop-pct", "--corrupt-pct"])
@pytest.mark.parametrize("value", ["-1", "nan", "inf"])
def test_links_that_cannot_be(run, option, value):
    status, out, err = run("simulate", RIG, option, value)
    assert (status, out) == (2, "")
    assert option[2:].partition("-")[0] in err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("run", RIG, "--force", "nan", "0", "0"), "--force is nan 0 0; give finite numbers"),
        (("run", RIG, "--at", "inf", "0", "0"), "--at is inf 0 0; give finite numbers"),
    ],
)
def test_places_and_forces_that_are_no_numbers(run, words, said):
    status, out, err = run(*words)
    assert (status, out) == (2, "")
    assert said in err
