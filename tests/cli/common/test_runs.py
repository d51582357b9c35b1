"""Which modules a verb reaches that renders forces: simulated ones in this process, or those that are named."""

from pathlib import Path

import numpy as np
import pytest
import typer

from tensionlab.cli.common.links import links_of_rig
from tensionlab.cli.common.runs import reach_modules
from tensionlab.demand import Pose
from tensionlab.hardware.runner.settings import RealClock
from tensionlab.model.files import load_rig
from tests.helpers.reachable import ReachableRig

PATH = Path(__file__).parents[3] / "datasets" / "rigs" / "bartels2026-validation.toml"
RIG = load_rig(PATH)
NAMES = [module.name for module in RIG.modules]


def test_without_a_word_they_are_simulated_and_hold_what_moves(capsys, simulated_time):
    place = RIG.home + np.array([0.1, 0.0, 0.0])
    group, clock, links = reach_modules(RIG, None, lambda time: Pose(place))
    assert capsys.readouterr().err == "No --modules given: simulating them in this process.\n"
    assert links == dict.fromkeys(NAMES, "sim:")
    group.prepare(RIG, 10)
    clock.wait_until(clock.now() + 0.1)
    for client in group.clients:
        client.listen()
    found = [client.telemetry.message.length for client in group.clients]
    np.testing.assert_allclose(found, RIG.lengths(place), atol=1e-3)
    group.close()


def test_links_are_those_of_the_modules_in_the_rigs_order(capsys, monkeypatch, simulated_time):
    reachable = ReachableRig(monkeypatch, RIG)
    urls = [reachable.urls[name] for name in NAMES]
    group, clock, links = reach_modules(RIG, " , ".join(urls), None)
    assert list(links.items()) == list(zip(NAMES, urls, strict=True))
    assert [client.hello().serial_number for client in group.clients] == [1, 2, 3, 4]
    assert isinstance(clock, RealClock)
    before = [module.seconds for module in reachable.world.modules]
    clock.wait_until(clock.now() + 0.1)
    passed = np.subtract([module.seconds for module in reachable.world.modules], before)
    np.testing.assert_allclose(passed, 0.1, atol=1e-3)
    group.close()
    assert capsys.readouterr().err == ""


def test_each_module_needs_a_link():
    with pytest.raises(typer.BadParameter, match=rf"has 2 links, .* has 4 modules \({', '.join(NAMES)}\)"):
        links_of_rig(RIG, "COM5,COM6")


def test_a_file_has_links_by_name(tmp_path):
    file = tmp_path / "modules.toml"
    file.write_text('[modules]\ntop = "COM5"\n', encoding="utf-8")
    assert links_of_rig(RIG, str(file)) == {"top": "COM5"}


def test_run_says_that_it_pulls_with_simulated_modules(run, simulated_time):
    status, out, err = run("run", PATH, "--force", "0", "0", "0.5", "--seconds", 0.3, "--json")
    assert (status, err) == (0, "No --modules given: simulating them in this process.\n")
    assert out.startswith("{")
