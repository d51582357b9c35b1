"""Rigs that come from CASPR and go to MuJoCo, by the command line."""

import json
import re
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest

from tensionlab.model.bodies import Body
from tensionlab.model.files import load_rig, save_rig

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"
BODIES = """<bodies_system><links><link_rigid num="1" name="Plate">
  <joint type="P_XZ" q_initial="1.0 0.5"/>
  <physical><mass>5</mass><com_location>0 0 0</com_location></physical>
  <parent><num>0</num><location>0 0 0</location></parent>
</link_rigid></links></bodies_system>"""
CABLE = """<cable_set id="{set}"><cable_ideal name="left" attachment_reference="com">
  <properties><force_min>1</force_min><force_max>{upper}</force_max></properties>
  <attachments>
    <attachment><link>0</link><location>0 0 2</location></attachment>
    <attachment><link>1</link><location>0 0 0</location></attachment>
  </attachments></cable_ideal></cable_set>"""


@pytest.fixture
def run(run):
    """Run `tensionlab rig` in this process: exit status, stdout, stderr."""
    return lambda *words: run("rig", *words)


@pytest.fixture
def caspr(tmp_path):
    bodies, cables = tmp_path / "plate_bodies.xml", tmp_path / "plate_cables.xml"
    bodies.write_text(BODIES)
    sets = CABLE.format(set="weak", upper=10) + CABLE.format(set="strong", upper=90)
    cables.write_text(f'<cables default_cable_set="weak">{sets}</cables>')
    return bodies, cables


def test_import_writes_a_rig_to_a_file_or_to_stdout(run, caspr, tmp_path):
    code, out, err = run("import", "--caspr", *caspr, "--out", tmp_path / "plate.toml")
    assert (code, err) == (0, "")
    assert "planar-point, 1 cables" in out
    rig = load_rig(tmp_path / "plate.toml")
    assert (rig.name, rig.home.tolist(), rig.limits.upper.tolist()) == ("plate", [1.0, 0.5], [10.0])
    code, out, _ = run("import", "--caspr", *caspr)
    assert code == 0
    assert out == (tmp_path / "plate.toml").read_text()


def test_import_takes_the_set_that_is_asked_for(run, caspr):
    assert "upper = 90.0" in run("import", "--caspr", *caspr, "--set", "strong")[1]
    code, _, err = run("import", "--caspr", *caspr, "--set", "stronger")
    assert code == 2
    assert "the ids are weak, strong" in err


def test_export_writes_a_model_that_mujoco_loads(run, tmp_path):
    code, out, err = run("export", RIGS / "ipanema-2.toml", "--out", tmp_path / "robot.xml")
    assert (code, err) == (0, "")
    assert "8 tendons" in out
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml")).ntendon == 8


def test_show_has_pulleys_where_there_are_some(run, tmp_path):
    rig = load_rig(RIGS / "bartels2026-validation.toml")
    assert "pulley" not in run("show", RIGS / "bartels2026-validation.toml")[1]
    first = replace(rig.modules[0], pulley_radius=0.02, pulley_axis=[0.0, 1.0, 0.0])
    save_rig(replace(rig, modules=(first, *rig.modules[1:])), tmp_path / "over.toml")
    code, out, err = run("show", tmp_path / "over.toml")
    assert (code, err) == (0, "")
    assert re.search(r"^floor-1 .* 0\.02  \(0, 1, 0\)$", out, re.MULTILINE)
    assert re.search(r"^floor-2 .* –\s+–$", out, re.MULTILINE)


def test_bodies_are_listed_and_checked_against_their_margins(run, tmp_path):
    rig = load_rig(RIGS / "bartels2026-validation.toml")
    assert "odies" not in run("show", RIGS / "bartels2026-validation.toml")[1]
    for distance, code, word in ((-0.3, 0, "0.180"), (-0.1, 1, "-0.020")):
        head = Body("head", [0.0, 1.2, distance], radius=0.12)
        save_rig(replace(rig, bodies=(head,)), tmp_path / "user.toml")
        out = run("show", tmp_path / "user.toml")[1]
        assert re.search(rf"^head .* 0\.12 m +0\.05 +{word}  top$", out, re.MULTILINE)
        (body,) = json.loads(run("show", tmp_path / "user.toml", "--json")[1])["bodies"]
        assert (body["shape"], body["margin"], round(body["distance_at_home"], 3)) == ("sphere", 0.05, float(word))
        assert run("check", tmp_path / "user.toml")[0] == code


def test_check_says_what_is_left_after_the_loss_of_a_module(run):
    for name, holds in (("seven-modules", True), ("bartels2026-validation", False)):
        code, out, _ = run("check", RIGS / f"{name}.toml")
        losses = json.loads(run("check", RIGS / f"{name}.toml", "--json")[1])["losses"]
        assert code == 0
        assert f"{name} at home after the loss of a module" in out
        assert {loss["holds"] for loss in losses} == {holds}
        words = "holds with the others" if holds else "falls short by"
        assert out.count(words) == len(losses)
