from dataclasses import fields
from pathlib import Path

import pytest

from tensionlab import records
from tensionlab.errors import ShapeError
from tensionlab.validation.trials import Trial, read, write
from tests.support.recorded import made_up_trials

CARD = Path(__file__).parents[2] / "datasets" / "what-if" / "README.md"


def test_what_was_written_is_read(tmp_path):
    rows = made_up_trials()
    write(tmp_path / "a-simulated.parquet", rows, {"call": "made up"})
    found = read(tmp_path / "a-simulated.parquet")
    assert found.rows == tuple(rows)
    assert found.manifest == {"call": "made up", "simulated": True}
    solvers = found.of("solver")
    assert list(solvers) == ["newton", "dykstra:10"]
    assert [row.seed for row in solvers["newton"]] == list(range(20))


def test_names_say_that_they_are_simulated_and_other_tables_are_refused(tmp_path):
    with pytest.raises(ShapeError, match="must say"):
        write(tmp_path / "a.parquet", made_up_trials(), {})
    records.write_parquet(tmp_path / "b.parquet", [{"question": "solver"}], {})
    with pytest.raises(ShapeError, match=r"b\.parquet: row 1: .angle. is missing"):
        read(tmp_path / "b.parquet")


def test_the_card_names_every_column():
    card = CARD.read_text(encoding="utf-8")
    assert all(f"`{field.name}`" in card for field in fields(Trial))
