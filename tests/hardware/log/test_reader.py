import json
import random
import re
import time
from dataclasses import asdict, replace

import jsonschema
import numpy as np
import pytest

import tensionlab as tl
from tensionlab.demand import Pose
from tensionlab.errors import LogError, TensionlabError
from tensionlab.hardware.log import scene
from tensionlab.hardware.log.mcap_file import McapWriter, read_records
from tensionlab.hardware.log.reader import MAX_EVENTS, describe_modules, read_run, recount, report, summarise
from tensionlab.hardware.log.writer import EVENT_SCHEMA, RunSetup
from tensionlab.hardware.runner.cycle_table import COLUMNS, TYPES, decode, encode, schema
from tensionlab.hardware.runner.records import RunEvent
from tensionlab.solvers.base import Status
from tests.helpers import runs
from tests.helpers.examples import many


@pytest.fixture(scope="module")
def seven(tmp_path_factory):
    """Return a run of seven modules, one of which is lost half way, and the cycles that were written."""
    file = tmp_path_factory.mktemp("logs") / "seven.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tensionlab.hardware.log.writer.FLUSH_S", 0.005)  # so that there is more than one chunk
        return file, runs.logged(file, runs.seven(), 120, lost=2)


def test_what_was_written_is_read_to_the_last_bit(seven):
    file, written = seven
    run = read_run(file)
    assert len(run) == len(written) == 120
    assert run.complete
    for index, cycle in enumerate(written):
        for name, column in COLUMNS.items():
            expected = np.array(column.value(cycle, run.rig), dtype=TYPES[name])
            if TYPES[name].kind == "f":
                expected[~np.isfinite(expected)] = np.nan
            np.testing.assert_array_equal(getattr(run, name)[index], expected, name)
        np.testing.assert_array_equal(run.allocation.wrench[index], cycle.allocation.wrench)
        if cycle.demand.wrench is None:
            assert np.isnan(run.desired[index]).all()
            assert list(run.impedances[index, 0, :2]) == [1.0, 50.0]
            assert list(run.commanded_brakes[index]) == 6 * [False] + [True]


def test_the_rest_of_the_log_is_read_too(seven):
    run = read_run(seven[0])
    assert (run.rig, run.manifest) == (runs.seven(), runs.MANIFEST)
    links = {module.name: f"sim:{module.name}" for module in run.rig.modules}
    limits = (tuple(each.tolist()) for each in (run.rig.limits.lower, run.rig.limits.upper))
    assert run.setup == RunSetup(
        "newton", vars(tl.solvers.make("newton")), "force", 50.0, 0.25, "stop", *limits, links
    )
    assert run.modules == {module.name: asdict(runs.INFO) for module in run.rig.modules}
    assert (run.summary["ended"], run.summary["missed"]) == ("stopped by the demand", 3)
    armed, lost, stopped = run.events
    assert (armed.kind, armed.cycle, armed.module) == ("armed", -1, "")
    assert (lost.kind, lost.cycle, lost.time, lost.module) == ("lost", 60, 1.2, run.rig.modules[2].name)
    assert (stopped.kind, stopped.cycle) == ("ended", 119)


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Return a log of which each message is flushed by itself, and the number of cycles that were written."""
    file = tmp_path_factory.mktemp("logs") / "short.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tensionlab.hardware.log.writer.FLUSH_S", 0.0)
        return file, len(runs.logged(file, runs.seven(), 20, lost=2))


def test_a_log_may_be_cut_anywhere(tmp_path, short):
    file, written = short
    empty = tmp_path / "empty.mcap"
    log = runs.new_log(empty, runs.seven())
    begin = empty.stat().st_size  # what is written before the run starts
    log.close()
    content, cut = file.read_bytes(), tmp_path / "cut.mcap"
    last = len(content) - 2000
    places = {*range(last, len(content), 23), *range(len(content) - 50, len(content), 3), begin - 1, begin}
    places |= {*range(0, begin, 397), *random.Random(0).sample(range(last), many(150))}
    found = []
    for size in sorted(places):
        cut.write_bytes(content[:size])
        try:
            run = read_run(cut)
        except LogError:
            assert size < begin
            continue
        assert size >= begin
        assert not run.complete
        assert list(run.cycle) == list(range(len(run)))
        found.append(len(run))
    assert found == sorted(found)
    assert (found[0], found[-1]) == (0, written)  # in the end all but the index was there
    assert len(set(found)) > 4


def test_what_is_no_log_is_refused(tmp_path):
    for content in (b"", b"name = 'rig'", b"\x89MCAP0\r\n"):
        file = tmp_path / "x.mcap"
        file.write_bytes(content)
        with pytest.raises(LogError, match=r"x\.mcap: not the log of a run"):
            read_run(file)
    with pytest.raises(LogError, match="is a folder; give the log of a run"):
        read_run(tmp_path)
    with pytest.raises(LogError, match=r"none\.mcap: cannot be read \(No such file"):
        read_run(tmp_path / "none.mcap")


def overflowing(name):
    """Return a change of a cycle after which its products would overflow."""

    def change(content):
        row = json.loads(content)
        row[name] = [1e308] * len(row[name]) if isinstance(row[name], list) else 1e308
        return json.dumps(row).encode()

    return change


@pytest.mark.parametrize(
    ("what", "change", "said"),
    [
        ("setup", lambda _: {"solver": 3}, "links is missing"),
        ("setup", lambda content: {**content, "rate": 0.0}, "setup.rate is 0.0; give more than 0"),
        ("setup", lambda content: {**content, "lower": [0.5]}, "setup has 1 tension limits for 4 modules"),
        ("modules", lambda _: {"floor-1": 3}, "modules.floor-1 is 3"),
        ("event", lambda _: b'{"cycle": 0}', "kind is missing"),
        ("event", lambda _: b"[" * 3000 + b"]" * 3000, "nested too deep"),
        ("cycle", lambda _: b'{"cycle": 0}', "a cycle in it is none of this rig"),
        ("cycle", lambda _: b"[" * 100_000, "a cycle in it is none of this rig (RecursionError)"),
        *(("cycle", overflowing(name), "it is damaged") for name in ("time", "start_delay", "commanded")),
        ("rig.toml", lambda _: b"a = " + b"[" * 3000, "nested too deep"),
    ],
)
def test_what_is_whole_and_makes_no_sense_is_refused(tmp_path, what, change, said):
    """A log whose checksums are right: it was written by another program, or another version."""
    good, bad = tmp_path / "good.mcap", tmp_path / "bad.mcap"
    runs.logged(good, runs.four(), 2)
    writer = McapWriter(bad, {"cycle": {"title": "c"}, "event": {"title": "e"}})
    for record in read_records(good):
        content = change(record.content) if record.name == what else record.content
        if record.kind == "attachment":
            writer.attachment(record.name, "text/plain", content)
        elif record.kind == "metadata":
            writer.metadata(record.name, content)
        elif record.name in ("cycle", "event"):
            writer.message(record.name, 1, 1, content)
    writer.finish()
    with pytest.raises(TensionlabError, match=re.escape(said)) as refused:
        read_run(bad)
    assert "bad.mcap" in str(refused.value)


def test_a_run_without_a_cycle_is_a_run(tmp_path):
    runs.logged(tmp_path / "run.mcap", runs.four(), 0)
    run = read_run(tmp_path / "run.mcap")
    assert run.complete
    assert np.isnan(run.began)
    assert run.chosen.shape == (0, 4)
    assert run.to_xarray().sizes["cycle"] == 0
    assert run.to_pandas().shape[0] == 0
    found = summarise(run)
    assert (found["cycles"], found["missed"], found["duration_s"]) == (0, 0, 0.0)
    assert found["modules"][0]["limiters"] == {}
    report(run)


@pytest.mark.parametrize("name", ["bartels2026-validation", "cogiro", "kntu-planar"])
def test_cycles_keep_to_their_schema_and_come_back(name):
    rig = tl.load_rig(name)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    rotation = {3: turn, 2: np.array(np.pi / 2)}[rig.dimension] if rig.n > rig.dimension else None
    expected = np.eye(rig.dimension) if rotation is None else turn[: rig.dimension, : rig.dimension]
    found, columns = schema(), {}
    kinds = {"number": ["number", "null"], "integer": "integer", "boolean": "boolean"}
    for column, rules in found["properties"].items():
        inner = {"type": kinds[rules.get("items", rules)["type"]]}
        rules = {**rules, "items": inner} if "items" in rules else inner  # noqa: PLW2901 - with what may be null
        columns[column] = jsonschema.Draft202012Validator(rules)
        columns[column].check_schema(rules)
    for cycle in runs.cycles(rig, 60):
        wrench = None if cycle.demand.wrench is None else cycle.demand.wrench + 1.0
        cycle = replace(  # noqa: PLW2901 - another pose and desired wrench
            cycle,
            demand=replace(cycle.demand, desired=wrench),
            state=replace(cycle.state, pose=Pose(cycle.state.pose.position, rotation)),
        )
        cycle.state.speeds[:2] = np.nan, -np.inf
        content = encode(cycle, rig)
        row = json.loads(content, parse_constant=pytest.fail)
        assert list(row) == list(COLUMNS) == list(found["properties"])
        for column, validator in columns.items():
            validator.validate(row[column])
        back = decode([content], rig)
        np.testing.assert_allclose(back["rotation"][0], expected, atol=1e-15)
        np.testing.assert_array_equal(back["speeds"][0, :2], [np.nan, np.nan])
        if wrench is not None:
            np.testing.assert_array_equal(back["desired"], [wrench])
            np.testing.assert_array_equal(back["demanded"], [cycle.demand.wrench])


def test_foxglove_reads_schemas_of_numbers_and_plain_lists():
    """It refuses a schema with anything else in it, and shows nothing of that channel then."""
    for whole in (schema(), EVENT_SCHEMA):
        assert whole["type"] == "object"
        for rules in whole["properties"].values():
            inner = rules["items"] if rules["type"] == "array" else rules
            assert inner["type"] in ("number", "integer", "boolean", "string")


def test_a_reader_tells_how_far_it_is(tmp_path, monkeypatch):
    monkeypatch.setattr("tensionlab.hardware.log.mcap_file.PROGRESS_MESSAGES", 10)
    runs.logged(tmp_path / "run.mcap", runs.four(), 100)
    shares = []
    read_run(tmp_path / "run.mcap", shares.append)
    messages = sum(record.kind == "message" for record in read_records(tmp_path / "run.mcap"))
    assert len(shares) == messages // 10 >= 10
    assert shares == sorted(shares)
    assert 0.0 < shares[0] <= shares[-1] <= 1.0


def test_other_readers_find_their_way(seven):
    """Foxglove and others read JSON by the schema, seek by the index, and show what is attached."""
    from mcap.reader import make_reader

    file, written = seven
    with file.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert {each.encoding for each in summary.schemas.values()} == {"jsonschema"}
        counts = {
            summary.channels[number].topic: count
            for number, count in summary.statistics.channel_message_counts.items()
        }
        assert counts == {"cycle": len(written), "event": 3, scene.TOPIC: 72}, "119 / 50 s at 30 Hz"
        assert summary.chunk_indexes
        times = [message.log_time for _, _, message in reader.iter_messages(["cycle"])]
        np.testing.assert_allclose(np.diff(times), 0.02e9, atol=1)
        assert [each.name for each in reader.iter_attachments()] == ["rig.toml"]
        assert [each.name for each in reader.iter_metadata()] == ["manifest", "setup", "modules", "summary"]


def test_datasets_and_tables_name_what_they_hold(seven):
    run = read_run(seven[0])
    name, dataset, table = run.rig.modules[3].name, run.to_xarray(), run.to_pandas()
    assert dict(dataset.sizes) == {
        "cycle": 120, "axis": 3, "platform_axis": 3, "component": 3, "module": 7, "impedance": 7,
        "frame": 0, "entry": 4,
    }  # fmt: skip
    assert set(dataset.variables) >= {*COLUMNS, "lower", "upper"}
    assert {"cycle", "time", "module", "component", "lower"} <= set(dataset.coords)
    assert list(dataset.component.values) == ["Fx", "Fy", "Fz"]
    np.testing.assert_array_equal(dataset.chosen.sel(module=name), run.chosen[:, 3])
    np.testing.assert_array_equal(dataset.sel(cycle=7).chosen, run.chosen[7])
    assert dataset.chosen.attrs["units"] == "N"
    assert json.loads(dataset.attrs["manifest"]) == runs.MANIFEST
    np.testing.assert_array_equal(table[f"chosen.{name}"], run.chosen[:, 3])
    np.testing.assert_array_equal(table[f"structure.Fy.{name}"], run.structure[:, 1, 3])
    np.testing.assert_array_equal(table["rotation.z.x"], run.rotation[:, 2, 0])
    assert list(table.index) == list(run.cycle)


def test_counts_and_shares_are_those_of_the_cycles(tmp_path):
    rig = runs.seven()
    cycles = runs.logged(tmp_path / "run.mcap", rig, 200, solver="dykstra", lost=2)
    run = read_run(tmp_path / "run.mcap")
    found = summarise(run)
    assert (found["rig"], found["solver"], found["policy"]) == ("seven-modules", "dykstra", "tension")
    assert (found["cycles"], found["missed"], found["slew_limited"]) == (200, 0, 0)
    assert found["duration_s"] == pytest.approx(199 / 50)
    statuses = [int(cycle.allocation.status) for cycle in cycles]
    assert [found["statuses"][status.name] for status in Status] == [statuses.count(each) for each in range(4)]
    assert found["statuses"]["NEAREST"] > 5
    assert found["fallback_used"] == sum(cycle.fallback_used for cycle in cycles)
    delays = np.percentile([cycle.start_delay for cycle in cycles], [50, 99, 100])
    assert list(found["start_delay_s"].values()) == pytest.approx(delays)
    assert (found["complete"], found["ended"]) == (True, "stopped by the demand")

    lost, kept = describe_modules(run)[2:4]
    assert (lost["name"], lost["faults"], lost["lost_at_s"]) == (rig.modules[2].name, ["ENCODER"], 2.0)
    assert (kept["faults"], kept["lost_at_s"]) == ([], None)
    taut = np.mean([cycle.state.limiters[3] == 1 for cycle in cycles])
    assert kept["limiters"] == {"LOWER": pytest.approx(taut)}
    title, whole, modules = report(run)[0].title, *map(str, report(run))
    assert title == "seven-modules, dykstra, nearest in tension"
    assert "200 in 3.98 s, 50 Hz desired" in whole
    assert "stopped by the demand" in whole
    assert f"lower {100 * taut:.0f} %" in modules
    events = (RunEvent(1, 0.02, "note", "text"),) * (MAX_EVENTS + 2)
    cut, notes = report(replace(run, complete=False, events=events))
    assert "cut off" in str(cut)
    assert (len(notes.notes), notes.notes[-1]) == (MAX_EVENTS + 1, "and 2 more events; --json has all")
    assert report(replace(run, events=events[2:]))[1].notes[-1] == notes.notes[0]
    sent = [cycle.commanded[2] for cycle in cycles[:100]]
    assert (lost["commanded_min_n"], lost["commanded_mean_n"]) == pytest.approx((min(sent), np.mean(sent)))
    assert 0.005 < kept["telemetry_age_s"]["median"] < kept["telemetry_age_s"]["max"] < 0.03


def test_missed_deadlines_slowed_set_points_and_the_time_of_day_are_told_by_the_cycles(tmp_path):
    before, log = time.time(), runs.new_log(tmp_path / "run.mcap", runs.four())
    for cycle in runs.cycles(runs.four(), 100):
        if cycle.state.cycle < 15:
            cycle.commanded[0] -= 5e-4
        if cycle.state.cycle >= 10 and cycle.state.cycle not in (30, 31, 70):  # the first one, of 0.2 s, is late
            log.write(cycle)
    log.close()
    run = read_run(tmp_path / "run.mcap")
    assert before <= run.began + 0.2 <= time.time()
    statistics = recount(run)
    assert (statistics.missed, statistics.slew_limited) == (3, 5)
