import dataclasses
from pathlib import Path

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.model.directions import circle, fibonacci, grid18
from tensionlab.validation.rig_check import check_losses, check_rig

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"


def findings(rig):
    return {finding.name: finding for finding in check_rig(rig)}


def verdicts(rig):
    return {name: finding.passed for name, finding in findings(rig).items()}


def published():
    return tl.load_rig(RIGS / "bartels2026-validation.toml")


def with_limits(rig, lower, upper):
    modules = [dataclasses.replace(module, lower=lower, upper=upper) for module in rig.modules]
    return dataclasses.replace(rig, modules=tuple(modules))


def test_the_published_rig_passes_with_its_published_strength():
    assert all(verdicts(published()).values())
    # The largest force that the rig renders in all 182 directions, side 1.0 m.
    strength = findings(published())["strength"].text
    assert strength.startswith("3.72 N in its weakest of 182 directions")
    assert "-0.00" not in strength
    assert "in addition to" not in strength
    assert findings(with_limits(published(), 0.0, 5e-4))["strength"].passed


def test_the_strength_is_the_edge_of_what_can_be_rendered():
    rig = published()
    structure = rig.structure_matrix(rig.home)
    strength = float(findings(rig)["strength"].text.split()[0])
    inside = tl.allocate(structure, 0.998 * strength * grid18(), rig.limits)
    outside = tl.allocate(structure, 1.002 * strength * grid18(), rig.limits)
    assert (inside.status == tl.Status.EXACT).all()
    assert (outside.status == tl.Status.NEAREST).any()


def test_three_modules_on_the_floor_cannot_hold_each_other():
    rig = tl.load_rig(RIGS / "floor-3.toml")
    assert verdicts(rig) == {"rank": True, "limits": True, "balance": False, "walls": True}
    assert "no wrench closure" in findings(rig)["balance"].text


@pytest.mark.parametrize(
    ("factor", "advice"),
    [(1000.0, "in mm, divide"), (75.0, "in mm, divide"), (0.001, "in km, multiply"), (10.0, "")],
)
def test_lengths_in_another_unit_are_questioned(factor, advice):
    rig = published()
    modules = tuple(dataclasses.replace(each, anchor=factor * each.anchor) for each in rig.modules)
    scaled = dataclasses.replace(rig, modules=modules, home=factor * rig.home)
    note = findings(scaled).get("scale")
    assert (note is not None) == bool(advice)
    if note is not None:
        assert note.passed is None
        assert advice in note.text
        assert f"has {scaled.lengths(scaled.home).max():.4g} m" in note.text


def test_limits_that_are_too_narrow_are_told_from_geometry():
    # 3:1 between the cables is needed at home, 1.1:1 is allowed.
    rig = with_limits(tl.load_rig(RIGS / "bartels2026-validation-0.3m.toml"), 1.0, 1.1)
    balance = findings(rig)["balance"]
    assert balance.passed is False
    assert "widen the limits" in balance.text


def test_a_suspended_robot_needs_its_weight():
    rig = tl.load_rig(RIGS / "cogiro.toml")
    assert verdicts(rig)["balance"] is None
    assert verdicts(rig)["weight"] is True
    assert verdicts(rig)["required"] is True
    assert verdicts(rig)["strength"] is True
    weightless = dataclasses.replace(rig, platform=None, required=tl.Requirement())
    assert verdicts(weightless)["balance"] is False


@pytest.mark.parametrize("name", ["cogiro", "caroca", "fast"])
def test_the_strength_of_a_suspended_robot_is_beside_its_weight(name):
    rig = tl.load_rig(name)
    structure, weight = rig.structure_matrix(rig.home), -rig.weight
    text = findings(rig)["strength"].text
    strength, torque = float(text.split()[0]), float(text.partition("torque ")[2].split()[0])
    for share, all_of_them in ((0.99, True), (1.01, False)):
        for first, size in ((0, strength), (3, torque)):
            wrenches = np.tile(weight, (182, 1))
            wrenches[:, first : first + 3] += share * size * grid18()
            exact = tl.allocate(structure, wrenches, rig.limits).status == tl.Status.EXACT
            assert exact.all() == all_of_them


def test_what_is_required_at_home_is_checked_with_what_is_missing():
    rig = dataclasses.replace(published(), required=tl.Requirement(wrench=[0.0, 3.0, 0.0], ball=1.0))
    found = findings(rig)["required"]
    assert found.passed
    margin = tl.workspace.capacity_margin(rig.structure_matrix(rig.home), rig.limits, rig.required.wrench)
    assert f"feasible, {margin - 1.0:.3g} N from the edge" in found.text
    found = findings(dataclasses.replace(rig, required=tl.Requirement(ball=5.0)))["required"]
    assert found.passed is False
    assert "infeasible by 1.32 N" in found.text


@pytest.mark.parametrize("name", ["cogiro", "ipanema-1", "ipanema-2", "kntu-planar"])
def test_held_tensions_balance_the_weight_and_its_torque(name):
    rig = tl.load_rig(RIGS / f"{name}.toml")
    rig = dataclasses.replace(rig, platform=tl.Platform(rig.platform.mass, com=0.01 * np.ones(rig.dimension)))
    structure = rig.structure_matrix(rig.home)
    found = tl.allocate(structure, -rig.weight, rig.limits)
    held = structure @ found.tensions
    assert held[: rig.dimension] == pytest.approx(9.81 * rig.platform.mass * rig.upward, abs=1e-5)
    # The weight acts at the centre of mass: what holds it has no torque about that point.
    arm, force = np.zeros(3), np.zeros(3)
    arm[: rig.dimension], force[: rig.dimension] = rig.platform.com, held[: rig.dimension]
    torque = np.cross(arm, force)
    assert held[rig.dimension :] == pytest.approx(torque if rig.dimension == 3 else torque[2:], abs=1e-5)


def test_a_weight_beyond_the_limits_is_found():
    rig = tl.load_rig(RIGS / "cogiro.toml")
    assert verdicts(dataclasses.replace(rig, platform=tl.Platform(50_000.0)))["weight"] is False


def test_too_few_or_flat_cables_lack_rank():
    rig = published()
    two = dataclasses.replace(rig, modules=rig.modules[:2])
    rank = check_rig(two)[0]
    assert rank.passed is False
    assert "fewer than 3" in rank.text
    flat = [dataclasses.replace(m, anchor=m.anchor * [1, 0, 1] + [0, 0.3, 0]) for m in rig.modules[:3]]
    level = dataclasses.replace(flat[0], name="fourth", anchor=[-1.0, 0.3, 0.2])
    rank = check_rig(dataclasses.replace(rig, modules=(*flat, level)))[0]
    assert rank.passed is False
    assert "in one plane" in rank.text


def test_cables_without_a_choice_are_noted_and_body_frames_too():
    assert verdicts(with_limits(published(), 2.0, 2.0))["limits"] is None
    rig = tl.load_rig(RIGS / "body-mounted.toml")
    note = findings(rig)["frames"]
    assert note.passed is None
    assert all(name in note.text for name in rig.frames)


def test_a_rig_on_a_body_is_checked_where_the_body_is_at_rest():
    rig = tl.load_rig(RIGS / "body-mounted.toml")
    assert verdicts(rig)["balance"] is True
    assert verdicts(dataclasses.replace(rig, rest=()))["balance"] is False  # all bodies in the origin


@pytest.mark.parametrize("path", sorted(RIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_every_rig_that_comes_along_can_be_checked_and_has_full_rank(path):
    rig = tl.load_rig(path)
    found = check_rig(rig)
    assert found[0].passed, found[0]
    assert np.all([finding.text for finding in found])


def test_brakes_too_strong_for_a_head_are_reported():
    head = tl.Body("head", [0.0, 1.6, -0.5], radius=0.12)
    worn = dataclasses.replace(published(), bodies=(head,))
    limits = findings(worn)["limits"].text
    assert "with brakes 768 N together, so not for a head, which allows 60 N" in limits
    gentle = [dataclasses.replace(module, brake=4.0) for module in published().modules]
    assert "head" not in findings(dataclasses.replace(worn, modules=tuple(gentle)))["limits"].text
    assert "head" not in findings(published())["limits"].text, "nothing is said of heads where there is none"


def test_the_stiffness_is_that_of_a_module_along_an_axis_and_elsewhere_of_the_host():
    rig = published()
    text = findings(rig)["walls"].text
    cosine = rig.structure_matrix(rig.home)[0].max()
    assert f"{500.0 * cosine**2:.0f} N/m towards +x" in text
    assert "500 N/m towards +y" in text, "a cable right above"
    assert "towards -x" not in text
    assert "elsewhere 33 N/m by the host (50 cycles/s, 20 ms late)" in text
    assert "walls" not in verdicts(tl.load_rig("cogiro"))


@pytest.mark.parametrize(
    ("margin", "sway", "passed"), [(0.17, 0.0, True), (0.19, 0.0, False), (0.05, 0.14, False)]
)
def test_bodies_that_are_closer_than_their_margins_are_found(margin, sway, passed):
    """The cable of `top` is upright; the head, of radius 0.12 m, is 0.3 m behind it."""
    head = tl.Body("head", [0.0, 1.2, -0.3], radius=0.12, margin=margin, sway=sway)
    finding = findings(dataclasses.replace(published(), bodies=(head,)))["bodies"]
    assert finding.passed is passed
    assert f"the cable of top is {0.18 - sway:.3f} m from head" in finding.text


@pytest.mark.parametrize("name", ["seven-modules", "body-mounted", "cogiro", "kntu-planar", "floor-3"])
def test_after_a_loss_the_others_render_what_is_said(name):
    """By the allocations of a run that continues without the module."""
    rig = tl.load_rig(name)
    structure = rig.structure_matrix(rig.home, frames=rig.at_rest)
    load = -rig.weight if name in ("cogiro", "floor-3") and rig.weight is not None else np.zeros(rig.n)
    forces = np.zeros((200, rig.n))
    forces[:, : rig.dimension] = circle(200) if rig.dimension == 2 else fibonacci(200)
    losses = check_losses(rig)
    assert [loss.module for loss in losses] == [module.name for module in rig.modules]
    for lost, loss in enumerate(losses):
        left = rig.limits.only(np.arange(rig.m) != lost)
        assert loss.holds == (tl.allocate(structure, load, left).status == tl.Status.EXACT)
        assert loss.holds == (loss.margin > -1e-6)
        exact = tl.allocate(structure, load + forces, left).status == tl.Status.EXACT
        assert loss.directions == pytest.approx(exact.mean(), abs=0.01)
        if not loss.holds:
            missing = tl.allocate(structure, load, left).wrench - load
            missing[rig.dimension :] /= rig.characteristic_length
            assert np.linalg.norm(missing) >= 0.999 * -loss.margin


def test_one_module_alone_has_nothing_to_lose():
    one = dataclasses.replace(published(), modules=published().modules[:1])
    assert check_losses(one) == []
