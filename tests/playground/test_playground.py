"""The playground in a real browser: its answers are those of Python, and what is dragged is what is solved."""

import importlib.util

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from tensionlab import datasets
from tensionlab.workspace.wrench_set import required_margin
from tests.helpers.browsers import HANGS_S, chromium, needs_browser
from tests.helpers.shared import make_once
from tests.stress import SHARE

pytestmark = [
    needs_browser,
    pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="no compiler for WebAssembly here"),
]
RIGS = [datasets.load(name) for name in datasets.names("rigs")]
ASK = """([name, solver, asked]) => asked.map(([position, rotation, wrench, policy]) => {
  const state = { ...tensionlab.app.fresh(name), solver, position, rotation, wrench, policy };
  const answer = tensionlab.solve(tensionlab.kernels, state);
  const [margin] = tensionlab.margins(tensionlab.kernels, state, [position]);
  return [answer.status, answer.tensions, answer.rendered, margin];
})"""


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    from playground.build import PAGE, main

    make_once(tmp_path_factory, "playground", lambda _: main())
    return PAGE


@pytest.fixture(scope="module")
def browser(page_file):
    with chromium() as browser:
        yield browser


@pytest.fixture
def page(browser, page_file):
    page = browser.new_page(viewport={"width": 1280, "height": 800}, has_touch=True)
    page.set_default_timeout(1000 * HANGS_S)
    page.errors, page.requests = [], []
    page.on("pageerror", lambda error: page.errors.append(error))  # noqa: PLW0108 - it takes functions only
    page.on("request", lambda request: page.requests.append(request.url))
    page.address = page_file.as_uri()
    opened(page)
    yield page
    assert not page.errors
    assert all(url.startswith(("file:", "data:", "blob:")) for url in page.requests)
    page.close()


def opened(page, link=""):
    """Open the page with a link, from nothing."""
    page.goto("about:blank")
    page.goto(page.address + link)
    page.wait_for_function("globalThis.tensionlab?.app.answer")
    return page


def state_of(page):
    return page.evaluate("tensionlab.app.state")


def handle(page, name):
    """Return where a handle is on the screen."""
    at = page.evaluate(
        "name => { const { app } = tensionlab;"
        "return app.camera.project(app.handles().find(([other]) => other === name)[1]); }",
        name,
    )
    return at["x"], at["y"]


def shown_answer(page):
    return page.evaluate("tensionlab.app.answer")


def drag(page, name, dx, dy):
    x, y = handle(page, name)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + dx / 2, y + dy / 2)
    page.mouse.move(x + dx, y + dy)
    page.mouse.up()
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def as_rotation(rig, vector):
    """Return rotation vectors as Python takes them."""
    if rig.home_orientation is None:
        return None
    return vector[:, 0] if rig.dimension == 2 else Rotation.from_rotvec(vector).as_matrix()


def problems(rig, count, random):
    """Return poses about home, wrenches about what the limits allow, and policies."""
    size = np.ptp(rig.anchors, axis=0).max()
    position = rig.home + 0.1 * size * random.uniform(-1, 1, (count, rig.dimension))
    rotation = 0.2 * random.standard_normal((count, 2 * rig.dimension - 3)) * (rig.home_orientation is not None)
    wrench = random.standard_normal((count, rig.n)) * rig.limits.upper.max() * random.uniform(0, 2, (count, 1))
    wrench[:, rig.dimension :] *= 0.1 * size
    return position, rotation, wrench, random.choice(["force", "tension", "direction"], count)


@pytest.mark.parametrize("rig", RIGS, ids=lambda rig: rig.name)
def test_the_page_answers_as_python_does(page, rig):
    count = int(10_000 * SHARE) // len(RIGS)
    position, rotation, wrench, policy = problems(rig, count, np.random.default_rng(0))
    asked = list(zip(position.tolist(), rotation.tolist(), wrench.tolist(), policy.tolist(), strict=True))
    statuses, tensions, rendered, margins = (
        np.array(column) for column in zip(*page.evaluate(ASK, [rig.name, "newton", asked]), strict=True)
    )
    turned = as_rotation(rig, rotation)
    unit = rig.limits.upper.max()
    structure = rig.structure_matrix(position, turned, rig.at_rest)
    np.testing.assert_allclose(margins, required_margin(rig, structure, rig.required, turned), atol=1e-9 * unit)
    for name in np.unique(policy):
        rows = policy == name
        turns = None if turned is None else turned[rows]
        expected = rig.allocate(wrench[rows], position[rows], turns, rig.at_rest, policy=name)
        assert [tl.Status(status).name for status in expected.status] == statuses[rows].tolist()
        np.testing.assert_allclose(tensions[rows], expected.tensions, atol=1e-9 * unit)
        found = expected.wrench - rig.required.middle(rig, turns)
        np.testing.assert_allclose(rendered[rows], found, atol=1e-8 * unit)


@pytest.mark.parametrize("solver", ["closed-form", "least-sum", "minimax", "safe"])
def test_other_solvers_choose_the_tensions_of_python(page, solver):
    for rig in RIGS:
        asked = problems(rig, int(200 * SHARE), np.random.default_rng(1))
        position, rotation, wrench, _ = asked
        rows = list(zip(*(column.tolist() for column in asked), strict=True))
        statuses, tensions, _, _ = zip(*page.evaluate(ASK, [rig.name, solver, rows]), strict=True)
        expected = rig.allocate(wrench, position, as_rotation(rig, rotation), rig.at_rest, solver=solver)
        assert [tl.Status(status).name for status in expected.status] == list(statuses)
        np.testing.assert_allclose(tensions, expected.tensions, atol=1e-7 * rig.limits.upper.max())


def test_the_chart_shows_that_a_linear_program_jumps_where_newton_does_not(page):
    opened(page, "#rig=seven-modules&show=profile")
    steps = {}
    for solver in ("newton", "least-sum"):
        page.select_option("#solver", solver)
        page.wait_for_function("tensionlab.app.frame === null")
        answers = page.evaluate("tensionlab.app.profile.answers")
        steps[solver] = np.abs(np.diff([answer["tensions"] for answer in answers], axis=0)).max()
    assert steps["least-sum"] > 3 * steps["newton"]


def test_the_answer_follows_what_is_dragged(page):
    rig = tl.load_rig("seven-modules")
    before = state_of(page)
    drag(page, "force", 120, -200)
    drag(page, "hand", -30, 20)
    after = state_of(page)
    assert not np.allclose(after["wrench"], before["wrench"])
    assert not np.allclose(after["position"], before["position"])
    expected = rig.allocate(after["wrench"], after["position"])
    answer = shown_answer(page)
    assert answer["status"] == tl.Status(expected.status).name == "NEAREST"
    np.testing.assert_allclose(answer["tensions"], expected.tensions, atol=1e-9)
    assert page.inner_text("#verdict") == "NEAREST"


def test_the_picture_turns_and_zooms_without_changing_the_state(page):
    before, place = state_of(page), handle(page, "force")
    page.mouse.move(60, 60)
    page.mouse.down()
    page.mouse.move(200, 90)
    page.mouse.up()
    page.mouse.wheel(0, 300)
    page.wait_for_function("tensionlab.app.frame === null")
    assert state_of(page) == before
    assert handle(page, "force") != place


def test_a_finger_drags_the_force(page):
    before = state_of(page)["wrench"]
    x, y = handle(page, "force")
    touch = page.context.new_cdp_session(page)
    for kind, points in (
        ("touchStart", [{"x": x + 15, "y": y}]),
        ("touchMove", [{"x": x + 80, "y": y - 60}]),
        ("touchEnd", []),
    ):
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    assert not np.allclose(state_of(page)["wrench"], before)


def test_keys_reach_what_a_pointer_does(page):
    before = state_of(page)
    page.focus("#scene")
    for key in ("ArrowUp", "n", "n", "ArrowLeft", "n", "PageDown", "+"):
        page.keyboard.press(key)
    after = state_of(page)
    assert not np.allclose(after["wrench"], before["wrench"])
    assert not np.allclose(after["position"], before["position"])
    assert len(after["rig"]["modules"]) == 8
    page.keyboard.press("Delete")
    assert len(state_of(page)["rig"]["modules"]) == 7


@pytest.mark.parametrize("name", ["seven-modules", "cogiro", "kntu-planar", "body-mounted"])
def test_a_changed_rig_gives_the_same_answer_in_python(page, name, tmp_path, monkeypatch, capsys):
    opened(page, f"#rig={name}")
    drag(page, 0, 25, -15)
    drag(page, "force", 40, -40)
    page.evaluate("tensionlab.app.setLimit(1, 'upper', 0.8 * tensionlab.app.state.rig.modules[1].upper)")
    monkeypatch.chdir(tmp_path)
    state = state_of(page)
    (tmp_path / f"{name}-edited.toml").write_text(page.evaluate("tensionlab.toRigFile(tensionlab.app.state)"))
    space = {}
    lines = page.evaluate("tensionlab.toPython(tensionlab.app.state)")
    exec(lines.replace("print(", "answer = ("), space)
    answer = page.evaluate("tensionlab.solve(tensionlab.kernels, tensionlab.app.state)")
    np.testing.assert_allclose(space["answer"].tensions, answer["tensions"], rtol=1e-6)
    assert state["rig"]["edited"]


def test_a_link_brings_the_state_back(page):
    opened(
        page, "#rig=spidar-g6x4&force=1,2,3,0.1,0,0&turn=0.1,0,0&policy=tension&solver=safe&show=polytope&level=2"
    )
    page.evaluate("tensionlab.app.addModule()")
    state = state_of(page)
    page.wait_for_function("location.hash.includes('modules')")
    opened(page, page.evaluate("location.hash"))
    assert state_of(page) == state
    assert (state["policy"], state["solver"]) == ("tension", "safe")
    assert len(state["rig"]["modules"]) == 9


@pytest.mark.parametrize(
    "link", ["#rig=nothing", "#force=1,x,2&at=1&modules=a~b;c", "#%", "#modules=a~1,2,3~~9~1"]
)
def test_a_link_that_makes_no_sense_shows_a_rig_all_the_same(page, link):
    opened(page, link)
    assert page.inner_text("#verdict") == "EXACT"
