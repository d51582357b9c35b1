import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tensionlab.errors import DataError, InputError, ShapeError
from tensionlab.solvers.base import Status
from tensionlab.support import provenance
from tensionlab.validation.data_tables import RecordingEntries, read_recording, write_recording
from tests.helpers.recorded import MODULES, made_up

ENTRIES = RecordingEntries.model_fields
DATASETS = Path(__file__).parents[2] / "datasets"
RECORDINGS_CARD = DATASETS / "recordings" / "README.md"


def test_what_was_written_is_read_recording(tmp_path):
    limited = np.where(np.arange(182) % 2, "top floor-1", "")
    recording = replace(
        made_up(), status=np.arange(182) % 4, fallback_used=np.arange(182) % 3 == 0, limited_modules=limited
    )
    write_recording(tmp_path / "a-simulated.parquet", recording)
    found = read_recording(tmp_path / "a-simulated.parquet")
    for field in fields(recording):
        np.testing.assert_array_equal(getattr(found, field.name), getattr(recording, field.name))
    assert found.simulated
    assert ", simulated: 182 forces of " in found.title
    np.testing.assert_array_equal(found.error, recording.measured - recording.desired)
    table = pq.read_table(tmp_path / "a-simulated.parquet")
    assert table["status"].to_pylist()[:4] == ["EXACT", "NEAREST", "UNPROVEN", "FAILED"]
    assert table["vector"].to_pylist() == list(range(182))
    np.testing.assert_array_equal(table["measured.Fy"], recording.measured[:, 1])


def test_a_name_says_whether_it_is_simulated(tmp_path):
    with pytest.raises(InputError, match="simulated, so its name must say"):
        write_recording(tmp_path / "rig.parquet", made_up())
    with pytest.raises(InputError, match="real, so its name must not say"):
        write_recording(tmp_path / "rig-simulated.parquet", made_up(simulated=False))
    write_recording(tmp_path / "rig.parquet", made_up(simulated=False))
    assert not read_recording(tmp_path / "rig.parquet").simulated


NO_ROTATION = {"rotations": {"paper": [[1.0, 0.0, 0.0]] * 2}}


@pytest.mark.parametrize(
    ("changes", "named"),
    [*(({name: None}, name) for name in ENTRIES), (NO_ROTATION, "rotations"), ({"alignment": "other"}, '"other"')],
)
def test_an_entry_that_is_wrong_is_named(changes, named):
    about = made_up().manifest["recording"] | changes
    with pytest.raises(DataError, match=named):
        replace(made_up(), manifest={"recording": about})


def test_other_tables_are_no_recordings(tmp_path):
    with pytest.raises(ShapeError, match=r"tensions has shape \(182, 3\), not \(182, 4\)"):
        replace(made_up(), tensions=np.ones((182, 3)))
    provenance.write_parquet(tmp_path / "a.parquet", [{"a": 1}], {})
    with pytest.raises(DataError, match=r"a\.parquet: the manifest of a recording has no"):
        read_recording(tmp_path / "a.parquet")
    with pytest.raises(DataError, match=r"nothing\.parquet: no such file; give the path of a recording"):
        read_recording(tmp_path / "nothing.parquet")


def test_the_card_of_recordings_names_every_column_and_entry(tmp_path):
    write_recording(tmp_path / "a-simulated.parquet", made_up())
    text = RECORDINGS_CARD.read_text(encoding="utf-8")
    named = set(re.findall(r"`([^`]+)`", text))
    for column in pq.read_schema(tmp_path / "a-simulated.parquet").names:
        name, _, part = column.partition(".")
        known = f"{name}.MODULE" if part in MODULES else f"{name}.Fx" if part else name
        assert known in named, column
    assert named >= set(ENTRIES)
    assert all(status.name in text for status in Status)
