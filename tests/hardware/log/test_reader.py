import json
import random
import re
import time
from dataclasses import asdict, replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.demand import Pose
from tensionlab.errors import LogError, TensionlabError
from tensionlab.hardware.log.mcap_file import McapWriter, read_records
from tensionlab.hardware.log.reader import read_run, report
from tensionlab.hardware.log.scene import TOPIC
from tensionlab.hardware.log.writer import EVENT_SCHEMA, RunSetup
from tensionlab.hardware.runner.cycle_table import (
    COLUMNS,
    TYPES,
    VALUES,
    decode,
    encode,
    schema,
)
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
        for name, value in VALUES.items():
            expected = np.array(value(cycle, run.rig), dtype=TYPES[name])
            if TYPES[name].kind == "f":
                expected[~np.isfinite(expected)] = np.nan
            np.testing.assert_array_equal(getattr(run, name)[index], expected, name)
        np.testing.assert_array_equal(run.allocation.tensions[index], cycle.allocation.tensions)
        np.testing.assert_array_equal(run.allocation.wrench[index], cycle.allocation.wrench)
        assert run.allocation.status[index] == cycle.allocation.status
        if cycle.demand.wrench is None:
            assert np.isnan(run.desired[index]).all()
            assert list(run.impedances[index, 0, :2]) == [1.0, 50.0]
            assert list(run.commanded_brakes[index]) == 6 * [False] + [True]


def test_desired_and_demanded_wrench_are_two_columns():
    rig = runs.four()
    (cycle,) = runs.cycles(rig, 1)
    desired = cycle.demand.wrench + 1.0
    found = decode([encode(replace(cycle, demand=replace(cycle.demand, desired=desired)), rig)], rig)
    np.testing.assert_array_equal(found["desired"], [desired])
    np.testing.assert_array_equal(found["demanded"], [cycle.demand.wrench])


def test_the_rest_of_the_log_is_read_too(seven):
    run = read_run(seven[0])
    assert run.rig == runs.seven()
    assert run.manifest == runs.MANIFEST
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


def test_a_run_tells_the_time_of_day_when_it_began(tmp_path):
    """Also where its first cycle, of 0.2 s, is late."""
    before, log = time.time(), runs.new_log(tmp_path / "run.mcap", runs.four())
    for cycle in runs.cycles(runs.four(), 15):
        if cycle.state.time >= 0.2:
            log.write(cycle)
    log.close()
    assert before <= read_run(tmp_path / "run.mcap").began + 0.2 <= time.time()


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Return a log of which each message is flushed by itself, and the cycles that were written."""
    file = tmp_path_factory.mktemp("logs") / "short.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tensionlab.hardware.log.writer.FLUSH_S", 0.0)
        return file, runs.logged(file, runs.seven(), 20, lost=2)


def test_a_log_may_be_cut_anywhere(tmp_path, short):
    file, written = short
    empty = tmp_path / "empty.mcap"
    log = runs.new_log(empty, runs.seven())
    begin = empty.stat().st_size  # what is written before the run starts
    log.close()
    content, cut = file.read_bytes(), tmp_path / "cut.mcap"
    last = len(content) - 2000
    places = [
        *range(last, len(content), 23),
        *range(len(content) - 50, len(content), 3),
        *range(0, begin, 397),
        begin - 1,
        begin,
    ]
    found = []
    for size in sorted([*places, *random.Random(0).sample(range(last), many(150))]):
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
    assert found[0] == 0
    assert found[-1] == len(written)  # all but the index was there
    assert len(set(found)) > 4


def test_damage_ends_the_log_where_it_is(tmp_path, short):
    file, written = short
    content, damaged = file.read_bytes(), tmp_path / "damaged.mcap"
    ends = random.Random(1)
    for _ in range(many(150)):
        place = ends.randrange(len(content) // 2, len(content))
        damaged.write_bytes(
            content[:place] + bytes([content[place] ^ (1 << ends.randrange(8))]) + content[place + 1 :]
        )
        run = read_run(damaged)
        assert list(run.cycle) == list(range(len(run)))
        assert len(run) <= len(written)


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
        ("setup", lambda _: {"x": 0}, "setup: row 1"),
        ("modules", lambda _: {"floor-1": 3}, "module 'floor-1' is 3"),
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


def test_metadata_nested_too_deep_are_damage(tmp_path):
    file = tmp_path / "x.mcap"
    writer = McapWriter(file, {})
    writer.metadata("first", {"a": 1})
    writer._writer.add_metadata("deep", {"a": "[" * 100_000})
    writer.finish()
    assert [record.name for record in read_records(file)] == ["first"]


def test_a_chunk_that_unpacks_to_more_than_the_memory_is_damage(tmp_path, monkeypatch):
    monkeypatch.setattr("tensionlab.hardware.log.mcap_file.MAX_CHUNK_BYTES", 1000)
    file = tmp_path / "x.mcap"
    writer = McapWriter(file, {"numbers": {"title": "n"}})
    writer.metadata("first", {"a": 1})
    writer.message("numbers", 1, 1, b" " * 2000)
    writer.finish()
    assert [record.name for record in read_records(file)] == ["first"]


def test_a_log_whose_chunks_unpack_to_much_in_all_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("tensionlab.support.files.reading.FREE_UNPACKED_BYTES", 1_000_000)
    file = tmp_path / "x.mcap"
    writer = McapWriter(file, {"numbers": {"title": "n"}})
    for _ in range(20):
        writer.message("numbers", 1, 1, b" " * 100_000)
        writer.flush()
    writer.finish()
    said = rf"x\.mcap: {file.stat().st_size:,} bytes that unpack to more than 1,[\d,]+ are not read"
    with pytest.raises(LogError, match=said):
        list(read_records(file))


def test_a_run_without_a_cycle_is_a_run(tmp_path):
    runs.logged(tmp_path / "run.mcap", runs.four(), 0)
    run = read_run(tmp_path / "run.mcap")
    assert run.complete
    assert np.isnan(run.began)
    assert run.chosen.shape == (0, 4)
    assert run.to_xarray().sizes["cycle"] == 0
    assert run.to_pandas().shape[0] == 0
    found = report(run)
    assert (found.statistics.cycles, found.statistics.missed, found.duration_s) == (0, 0, 0.0)
    assert np.isnan(found.statistics.percentiles()["start_delay"]).all()
    assert found.modules[0].limiters == {}


def test_cycles_keep_to_their_schema():
    rig = runs.four()
    rules = schema(rig)["properties"]
    for cycle in runs.cycles(rig, 60):
        row = json.loads(encode(cycle, rig))
        assert list(row) == list(COLUMNS) == list(rules)
        for name, value in row.items():
            values = value if isinstance(value, list) else [value]
            assert isinstance(value, list) == (rules[name]["type"] == "array")
            if isinstance(value, list):
                assert len(value) == rules[name]["minItems"] == rules[name]["maxItems"]
            kind = {"f": (float, int, type(None)), "i": int, "b": bool}[TYPES[name].kind]
            assert all(isinstance(each, kind) for each in values), name


def test_json_knows_neither_nan_nor_infinity():
    rig = runs.four()
    cycle = next(runs.cycles(rig, 2))
    cycle.state.speeds[:3] = np.nan, np.inf, -np.inf

    def refuse(word):
        raise AssertionError(word)

    row = json.loads(encode(cycle, rig), parse_constant=refuse)
    assert row["speeds"][:3] == [None, None, None]
    assert row["speeds"][3] == cycle.state.speeds[3]


def test_foxglove_reads_schemas_of_numbers_and_plain_lists():
    """It refuses a schema with anything else in it, and shows nothing of that channel then."""
    for whole in (schema(runs.seven()), EVENT_SCHEMA):
        assert whole["type"] == "object"
        for rules in whole["properties"].values():
            inner = rules["items"] if rules["type"] == "array" else rules
            assert inner["type"] in ("number", "integer", "boolean", "string")
            assert all(type(each["const"]) is int for each in rules.get("oneOf", []))


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
        assert {channel.topic for channel in summary.channels.values()} == {"cycle", "event", TOPIC}
        assert {each.encoding for each in summary.schemas.values()} == {"jsonschema"}
        counts = {
            summary.channels[number].topic: count
            for number, count in summary.statistics.channel_message_counts.items()
        }
        assert (counts["cycle"], counts["event"]) == (len(written), 3)
        assert summary.chunk_indexes
        times = [message.log_time for _, _, message in reader.iter_messages(["cycle"])]
        steps = np.diff(times)
        np.testing.assert_allclose(steps, 0.02e9, atol=1)
        assert [each.name for each in reader.iter_attachments()] == ["rig.toml"]
        assert [each.name for each in reader.iter_metadata()] == ["manifest", "setup", "modules", "summary"]


def test_a_platform_may_be_turned(tmp_path):
    rig = tl.load_rig(runs.RIGS / "cogiro.toml")
    cycle = next(runs.cycles(rig, 2))
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    object.__setattr__(cycle.state, "pose", Pose(cycle.state.pose.position, turn))
    assert json.loads(encode(cycle, rig))["rotation"] == turn.ravel().tolist()
    planar = tl.load_rig(runs.RIGS / "kntu-planar.toml")
    cycle = next(runs.cycles(planar, 2))
    object.__setattr__(cycle.state, "pose", Pose(cycle.state.pose.position, np.array(np.pi / 2)))
    np.testing.assert_allclose(json.loads(encode(cycle, planar))["rotation"], [0, -1, 1, 0], atol=1e-15)


def test_a_dataset_names_what_it_holds(seven):
    run = read_run(seven[0])
    dataset = run.to_xarray()
    assert dict(dataset.sizes) == {
        "cycle": 120, "axis": 3, "platform_axis": 3, "component": 3, "module": 7, "impedance": 6,
    }  # fmt: skip
    assert set(dataset.variables) >= {*COLUMNS, "lower", "upper"}
    assert list(dataset.component.values) == ["Fx", "Fy", "Fz"]
    pulled = dataset.chosen.sel(module=run.rig.modules[3].name)
    np.testing.assert_array_equal(pulled.sel(cycle=7), run.chosen[7, 3])
    assert dataset.chosen.attrs["units"] == "N"
    assert json.loads(dataset.attrs["manifest"]) == runs.MANIFEST
    assert float(dataset.time[-1]) == 119 / 50
    assert (dataset.status == Status.EXACT).any()


def test_counts_and_shares_are_those_of_the_cycles(tmp_path):
    rig = runs.seven()
    cycles = runs.logged(tmp_path / "run.mcap", rig, 200, solver="dykstra", lost=2)
    found = report(read_run(tmp_path / "run.mcap"))
    assert (found.rig, found.solver, found.policy) == ("seven-modules", "dykstra", "tension")
    statistics = found.statistics
    assert (statistics.cycles, statistics.missed, statistics.slew_limited) == (200, 0, 0)
    assert found.duration_s == pytest.approx(199 / 50)
    statuses = [int(cycle.allocation.status) for cycle in cycles]
    assert [statistics.statuses[status] for status in Status] == [statuses.count(status) for status in range(4)]
    assert statistics.statuses[Status.NEAREST] > 5
    assert statistics.fallback_used == sum(cycle.fallback_used for cycle in cycles)
    assert statistics.percentiles()["start_delay"] == pytest.approx(
        np.percentile([cycle.start_delay for cycle in cycles], [50, 99, 100])
    )
    assert found.complete
    assert statistics.ended == "stopped by the demand"

    lost, kept = found.modules[2], found.modules[3]
    assert (lost.name, lost.faults, lost.lost_at_s) == (rig.modules[2].name, ["ENCODER"], 2.0)
    assert (kept.faults, kept.lost_at_s) == ([], None)
    taut = np.mean([cycle.state.limiters[3] == 1 for cycle in cycles])
    assert kept.limiters == {"LOWER": pytest.approx(taut)}
    sent = [cycle.commanded[2] for cycle in cycles[:100]]
    assert (lost.commanded_min_n, lost.commanded_mean_n) == pytest.approx((min(sent), np.mean(sent)))
    assert 0.005 < kept.telemetry_age_s["median"] < kept.telemetry_age_s["max"] < 0.03


def test_missed_deadlines_and_slowed_set_points_are_seen_in_the_cycles(tmp_path):
    log = runs.new_log(tmp_path / "run.mcap", runs.four())
    for cycle in runs.cycles(runs.four(), 100):
        if cycle.state.cycle < 5:
            cycle.commanded[0] -= 0.1
        if cycle.state.cycle not in (30, 31, 70):
            log.write(cycle)
    log.close()
    statistics = report(read_run(tmp_path / "run.mcap")).statistics
    assert (statistics.missed, statistics.slew_limited) == (3, 5)


def test_flat_columns_are_the_entries_of_the_arrays(seven):
    run = read_run(seven[0])
    table = run.to_pandas()
    name = run.rig.modules[3].name
    np.testing.assert_array_equal(table[f"chosen.{name}"], run.chosen[:, 3])
    np.testing.assert_array_equal(table[f"structure.Fy.{name}"], run.structure[:, 1, 3])
    np.testing.assert_array_equal(table["rotation.z.x"], run.rotation[:, 2, 0])
    np.testing.assert_array_equal(table["status"], run.status)
    assert list(table.index) == list(run.cycle)
