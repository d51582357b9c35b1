"""The page of a log: its turns without a browser, and once in a real one with the log of a real run."""

import pytest

from tensionlab.hardware.log.reader import read_run
from tensionlab.viewer import playback, replay
from tensionlab.viewer.playback import cycle_at
from tensionlab.viewer.replay import ReplayPage
from tensionlab.viewer.server import PageServer
from tests.helpers import runs
from tests.helpers.browsers import HANGS_S, chromium, needs_browser, until
from tests.helpers.simulated_time import SimulatedTime


@pytest.fixture
def page(tmp_path, monkeypatch):
    """The page of a run of seven modules one of which is lost, in a time of its own."""
    passing = SimulatedTime()
    monkeypatch.setattr(replay, "time", passing)
    runs.logged(tmp_path / "run.mcap", runs.seven(), 120, lost=2)
    made = ReplayPage(read_run(tmp_path / "run.mcap"), PageServer())
    made.passing = passing
    yield made
    made.close()


def passes(page, seconds):
    page.passing.sleep(seconds)
    page.turn()


@pytest.mark.realtime  # a real server
def test_what_people_do_becomes_of_the_state_and_the_table_follows(page):
    assert "LOST" not in page._modules.content
    page.change(lambda state: playback.seek(state, 1.3))
    passes(page, 0.1)
    assert page.index == cycle_at(page._run.time, 1.3) == 65
    assert page._modules.content.count("LOST") == 1
    assert "cycle 65 at 50 Hz" in page._heading.content
    assert page._slider.value == 1.3
    page.change(playback.choose(speed=0.5))
    page.change(playback.play)
    passes(page, 0.0)
    passes(page, 0.4)
    assert page.state.time == pytest.approx(1.5)
    passes(page, 60.0)
    assert (page.state.time, page.state.playing) == (page._run.time[-1], False)
    page.change(playback.choose(solver="closed-form"))
    passes(page, 0.1)
    assert "closed-form" in page._forces.content
    page.change(playback.choose(kind="limiter"))
    passes(page, 0.1)
    assert all(mark.kind == "limiter" for mark in page.listed)
    assert len(page._jump.options) == 1 + len(page.listed)


@pytest.mark.slow
@needs_browser
@pytest.mark.realtime  # a run on simulated modules, and a real browser
def test_a_real_log_is_scrubbed_played_and_jumped_through(tmp_path, run):
    (tmp_path / "push.toml").write_text(
        'name = "push"\n[[steps]]\nseconds = 0.6\nwrench = [0.0, 0.0, 1.0]\n'
        "[[steps]]\nseconds = 0.6\nwrench = [0.0, 0.0, 40.0]\n"
    )
    log = tmp_path / "run.mcap"
    words = ("run", "bartels2026-validation", "--program", tmp_path / "push.toml", "--seconds", "1.2")
    assert run(*words, "--log", log)[0] == 0
    played = read_run(log)
    page = ReplayPage(played, PageServer())
    try:
        with chromium() as browser:
            tab = browser.new_page(viewport={"width": 1280, "height": 800})
            tab.set_default_timeout(1000.0 * HANGS_S)
            tab.goto(page.server.url)

            def sees(text):
                """Wait until the page shows a text, while it is served."""

                def there():
                    page.turn()
                    tab.wait_for_timeout(20.0)
                    return tab.get_by_text(text).count()

                until(there, text)

            def tension(index):
                return f"{played.measured[index, -1]:.2f} N"

            sees("EXACT")
            time = tab.locator("//*[normalize-space(text())='time s']/following::input[not(@type='hidden')][1]")
            time.fill("0.400")
            time.press("Enter")
            sees(f"cycle {played.cycle[cycle_at(played.time, 0.4)]} at 50 Hz")
            sees(tension(cycle_at(played.time, 0.4)))
            tab.get_by_role("button", name="Play", exact=True).click()
            sees("NEAREST")  # by itself, after 0.6 s
            tab.get_by_role("button", name="Pause", exact=True).click()
            tab.get_by_role("tab", name="Events").click()
            tab.locator("//*[normalize-space(text())='go to']/following::input[1]").click()
            [first] = [mark for mark in page.listed if mark.kind == "status"]
            tab.get_by_role("option", name=f"{first.time:.2f} s NEAREST").click()
            sees(f"cycle {played.cycle[cycle_at(played.time, first.time)]} at 50 Hz")
            tab.get_by_role("tab", name="Modules").click()
            sees(tension(cycle_at(played.time, first.time)))
    finally:
        page.close()
