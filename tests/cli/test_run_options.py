"""Numbers that no run can go by are refused before anything is done, with the option's name."""

import pytest

RIG = "datasets/rigs/bartels2026-validation.toml"


@pytest.mark.parametrize("value", ["-1", "0", "nan", "inf"])
def test_rates_and_times_are_finite_and_above_0(run, value):
    for words in (
        *(("run", RIG, option) for option in ("--seconds", "--rate", "--ttl")),
        *(("serve", RIG, option) for option in ("--seconds", "--rate")),
        ("serve", "--scenario", "bow", "--rate"),
        ("scenario", "bow", "--seconds"),
    ):
        status, out, err = run(*words, value)
        assert (status, out) == (2, "")
        assert words[-1] in err
        assert f"got {float(value):g}" in err


@pytest.mark.parametrize("option", ["--latency-ms", "--jitter-ms", "--drop-pct", "--corrupt-pct"])
def test_links_that_cannot_be_are_refused(run, option):
    for value in ("-1", "nan", "inf"):
        status, out, err = run("simulate", RIG, option, value)
        assert (status, out) == (2, "")
        assert option[2:].partition("-")[0] in err
