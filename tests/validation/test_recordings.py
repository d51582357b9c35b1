import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tensionlab import records
from tensionlab.errors import ShapeError
from tensionlab.solvers.base import Status
from tensionlab.validation.recordings import ABOUT, read, write
from tests.support.recorded import MODULES, made_up

CARD = Path(__file__).parents[2] / "datasets" / "recordings" / "README.md"


def test_what_was_written_is_read(tmp_path):
    hindered = np.where(np.arange(182) % 2, "top floor-1", "")
    recording = replace(made_up(), status=np.arange(182) % 4, replaced=np.arange(182) % 3 == 0, hindered=hindered)
    write(tmp_path / "a-simulated.parquet", recording)
    found = read(tmp_path / "a-simulated.parquet")
    for field in fields(recording):
        np.testing.assert_array_equal(getattr(found, field.name), getattr(recording, field.name))
    assert found.simulated
    table = pq.read_table(tmp_path / "a-simulated.parquet")
    assert table["status"].to_pylist()[:4] == ["EXACT", "NEAREST", "ITERATION_LIMIT", "FAILED"]
    assert table["vector"].to_pylist() == list(range(182))
    np.testing.assert_array_equal(table["measured.Fy"], recording.measured[:, 1])


def test_the_sensors_own_axes_are_one_rotation_away():
    recording = made_up(turn=np.pi / 2)
    # Turning the sensor's axes to the rig's maps its z onto x.
    np.testing.assert_allclose(recording.in_sensor_axes()[:, 2], recording.measured[:, 0])
    np.testing.assert_allclose(recording.in_sensor_axes()[:, 1], recording.measured[:, 1])


def test_a_name_says_whether_it_is_simulated(tmp_path):
    with pytest.raises(ShapeError, match="simulated, so its name must say"):
        write(tmp_path / "rig.parquet", made_up())
    with pytest.raises(ShapeError, match="real, so its name must not say"):
        write(tmp_path / "rig-simulated.parquet", made_up(simulated=False))
    write(tmp_path / "rig.parquet", made_up(simulated=False))
    assert not read(tmp_path / "rig.parquet").simulated


@pytest.mark.parametrize("name", ABOUT)
def test_an_entry_that_is_missing_is_named(name):
    about = {key: value for key, value in made_up().manifest["recording"].items() if key != name}
    with pytest.raises(ShapeError, match=name):
        replace(made_up(), manifest={"recording": about})


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(ShapeError, match=r"tensions has shape \(182, 3\), not \(182, 4\)"):
        replace(made_up(), tensions=np.ones((182, 3)))


def test_other_tables_are_no_recordings(tmp_path):
    records.write_parquet(tmp_path / "a.parquet", [{"a": 1}], {})
    with pytest.raises(ShapeError, match=r"a\.parquet: the manifest of a recording has no"):
        read(tmp_path / "a.parquet")
    with pytest.raises(ShapeError, match=r"nothing\.parquet: no such file; give the path of a recording"):
        read(tmp_path / "nothing.parquet")


def test_the_card_names_every_column_and_entry(tmp_path):
    write(tmp_path / "a-simulated.parquet", made_up())
    text = CARD.read_text(encoding="utf-8")
    told = set(re.findall(r"`([^`]+)`", text))
    for column in pq.read_schema(tmp_path / "a-simulated.parquet").names:
        name, _, part = column.partition(".")
        known = f"{name}.MODULE" if part in MODULES else f"{name}.Fx" if part else name
        assert known in told, column
    assert told >= set(ABOUT)
    assert all(status.name in text for status in Status)
