"""Every data set loads by its name, is the one that was committed, and has a card that tells its columns."""

import hashlib
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import tensionlab as tl
from tensionlab.errors import DataError, InputError
from tensionlab.model.directions import grid18
from tensionlab.support.files import reading
from tensionlab.validation.data_tables import write_recording
from tests.helpers.recorded import made_up

DATASETS = Path(__file__).parents[1] / "datasets"
DATA = (".csv", ".json", ".npz", ".parquet", ".toml")
TABLES = sorted(DATASETS.rglob("*.parquet"))


def test_every_file_is_the_one_that_was_committed():
    lines = (DATASETS / "SHA256SUMS").read_text(encoding="utf-8").splitlines()
    listed = {name: digest for digest, name in (line.split("  ") for line in lines)}
    there = {path.relative_to(DATASETS).as_posix(): path for path in DATASETS.rglob("*") if path.suffix in DATA}
    found = {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in there.items()}
    assert found == listed, "run `make checksums` if the change is meant"


def test_one_command_writes_the_checksums(tmp_path):
    shutil.copytree(DATASETS, tmp_path / "datasets")
    sums = tmp_path / "datasets" / "SHA256SUMS"
    sums.unlink()
    (tmp_path / "tools").mkdir()
    program = shutil.copy(DATASETS.parent / "tools" / "checksums.py", tmp_path / "tools")
    subprocess.run([sys.executable, program], check=True, capture_output=True)
    assert sums.read_bytes() == (DATASETS / "SHA256SUMS").read_bytes()


@pytest.mark.parametrize("name", [name for name in tl.datasets.names() if not name.startswith("problems/")])
def test_each_loads_by_its_name(name):
    assert tl.datasets.load(name) is not None


def test_every_table_is_a_data_set_with_a_card_and_a_manifest():
    names = tl.datasets.names()
    for path in TABLES:
        assert f"{path.parent.name}/{path.stem}" in names
        assert b"tensionlab" in pq.read_schema(path).metadata
        card = (path.parent / "README.md").read_text(encoding="utf-8")
        for column in pq.read_schema(path).names:
            assert f"`{column.partition('.')[0]}" in card, f"{path.name}: {column}"


@pytest.mark.parametrize("folder", ["vectors", "published", "recordings", "what-if", "benchmarks", "tracks"])
def test_a_card_says_origin_licence_and_how_to_regenerate(folder):
    card = (DATASETS / folder / "README.md").read_text(encoding="utf-8")
    for word in ("**Origin.**", "**Licence.**", "**Regenerate.**", "**Load.**"):
        assert word in card


def test_the_vectors_are_the_grid():
    vectors = tl.datasets.load("vectors/grid18")
    np.testing.assert_array_equal(vectors, grid18())
    table = pq.read_table(DATASETS / "vectors" / "grid18.parquet")
    polar, azimuth = (np.radians(table[name].to_numpy()) for name in ("polar", "azimuth"))
    made = np.stack([np.sin(polar) * np.cos(azimuth), np.cos(polar), np.sin(polar) * np.sin(azimuth)], axis=1)
    np.testing.assert_allclose(made, vectors, atol=1e-12)
    assert np.count_nonzero(np.abs(vectors[:, 1]) > np.cos(np.radians(18.5))) == 42


def test_what_the_publication_found():
    published = tl.datasets.load("published/bartels2026-validation")
    assert "arXiv 2603.08054" in published.attrs["source"]
    values = {name: (row["value"], row["unit"]) for name, row in published.iterrows()}
    assert values == {
        "force": (1.5, "N"),
        "vectors": (182, ""),
        "hold": (1.0, "s"),
        "rate": (1000.0, "Hz"),
        "angle_mean": (14.0, "°"),
        "angle_bound": (45.0, "°"),
        "magnitude_mean": (1.84, "N"),
        "magnitude_error_mean": (0.58, "N"),
    }
    assert "error vector" in published["reading"]["magnitude_error_mean"]
    devices = tl.datasets.load("published/haptic-devices")
    assert {"STRIVE", "SPIDAR-G", "Reel Feel", "Haply Inverse3", "Phantom Omni"} <= set(devices.index)
    assert (devices["source"].str.len() > 20).all()
    assert devices["force"]["Novint Falcon"] == 8.0


def test_a_recording_of_ones_own_loads_the_same_way(tmp_path):
    (tmp_path / "recordings").mkdir()
    write_recording(tmp_path / "recordings" / "our-rig.parquet", made_up(simulated=False))
    assert tl.datasets.names("recordings", tmp_path) == ["recordings/our-rig"]
    assert not tl.datasets.load("recordings/our-rig", tmp_path).simulated


def test_a_name_that_is_not_there_is_refused_with_the_one_that_is_close():
    with pytest.raises(InputError, match="did you mean 'vectors/grid18'"):
        tl.datasets.load("vectors/grid-18")
    with pytest.raises(InputError, match="is text, such as 'vectors/grid18'; got 5"):
        tl.datasets.load(5)
    with pytest.raises(InputError, match="no data sets are called 'recording'"):
        tl.datasets.names("recording")


def test_without_the_folder_the_error_says_where_they_should_be(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="no such folder"):
        tl.datasets.load("vectors/grid18", tmp_path / "nowhere")
    monkeypatch.setattr(reading, "DATASETS_FOLDERS", (tmp_path,))  # not ours: no checksums
    with pytest.raises(DataError, match="the data sets are not here; install tensionlab again"):
        tl.datasets.load("vectors/grid18")


def test_a_copy_inside_the_package_is_found_like_the_source(tmp_path, monkeypatch):
    monkeypatch.setattr(reading, "DATASETS_FOLDERS", (tmp_path / "nowhere", DATASETS))
    assert tl.datasets.folder() == DATASETS
    monkeypatch.setattr(reading, "DATASETS_FOLDERS", (DATASETS, tmp_path / "nowhere"))
    assert tl.datasets.folder() == DATASETS


def test_damaged_files_are_refused(tmp_path):
    for name in (
        "vectors/grid18.parquet",
        "published/bartels2026-validation.toml",
        "recordings/a.parquet",
        "what-if/a.parquet",
    ):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_bytes(b"PAR1 = nonsense")
        with pytest.raises(DataError, match=Path(name).name):
            tl.datasets.load(name.partition(".")[0], tmp_path)
