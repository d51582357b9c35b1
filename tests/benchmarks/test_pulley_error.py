"""What leaving pulleys out costs, measured."""

import numpy as np

import tensionlab as tl
from benchmarks.pulley_error import RIG, errors, main, samples


def test_tiny_pulleys_cost_nothing_and_larger_ones_as_much_more():
    rig = tl.load_rig(RIG)
    here = samples(rig, 50)
    assert len(here[0]) == 50
    np.testing.assert_allclose(errors(rig, 1e-12, *here), 0.0, atol=1e-6)
    small, large = (np.median(errors(rig, radius, *here), axis=1) for radius in (1e-3, 2e-3))
    np.testing.assert_allclose(large / small, 2.0, rtol=0.1)


def test_the_table_has_a_row_for_each_radius(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["pulley_error", "--count", "40"])
    main()
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("40 positions")
    assert [line.split(" mm")[0].strip() for line in lines[2:]] == ["2", "5", "10", "20", "40"]
