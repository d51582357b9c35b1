import numpy as np
import pytest

from tensionlab.errors import DataError, InputError, ShapeError
from tensionlab.model import directions


def test_grid18_has_the_published_count_of_distinct_unit_vectors():
    vectors = directions.grid18()
    assert vectors.shape == (182, 3)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0, atol=1e-15)
    assert len(np.unique(vectors.round(9), axis=0)) == 182


def test_grid18_is_an_18_degree_grid_with_its_poles_on_y():
    vectors = directions.grid18()
    np.testing.assert_array_equal(vectors[[0, -1]], [[0, 1, 0], [0, -1, 0]])
    polar = np.degrees(np.arccos(vectors[:, 1].clip(-1, 1)))
    np.testing.assert_allclose(polar[1:-1].reshape(9, 20), 18.0 * np.arange(1, 10)[:, None] * np.ones(20))
    # Neighbours on the equator, and from ring to ring, are 18 degrees apart.
    rings = vectors[1:-1].reshape(9, 20, 3)
    equator = np.einsum("ij,ij->i", rings[4], np.roll(rings[4], 1, axis=0))
    meridian = np.einsum("rij,rij->ri", rings[1:], rings[:-1])
    np.testing.assert_allclose(np.degrees(np.arccos(equator)), 18.0)
    np.testing.assert_allclose(np.degrees(np.arccos(meridian)), 18.0)


@pytest.mark.parametrize("count", [1, 2, 500])
def test_fibonacci_is_spread_evenly(count):
    vectors = directions.fibonacci(count)
    assert vectors.shape == (count, 3)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0, atol=1e-14)
    if count == 500:
        # The second moment of the uniform sphere is a third of the identity.
        np.testing.assert_allclose(vectors.T @ vectors / count, np.eye(3) / 3, atol=2e-3)
        cosine = vectors @ vectors.T - 2 * np.eye(count)
        policy = np.degrees(np.arccos(cosine.max(axis=1)))
        assert policy.min() > 0.8 * np.degrees(np.sqrt(4 * np.pi / count))
        golden = np.arctan2(vectors[1, 2], vectors[1, 0]) - np.arctan2(vectors[0, 2], vectors[0, 0])
        assert np.degrees(golden) == pytest.approx(137.50776)


def test_circle_is_evenly_spaced():
    vectors = directions.circle(8)
    np.testing.assert_allclose(vectors[:3], [[1, 0], [0.5**0.5, 0.5**0.5], [0, 1]], atol=1e-15)
    assert directions.parse("circle:8").shape == (8, 2)


@pytest.mark.parametrize("text", ["x,y,z\n1,0,0\n0,2,0\n", "\ufeffx, y, z\n1,0,0\n\n 0 , 2 , 0\n"])
def test_tables_of_directions_are_unit_vectors(tmp_path, text):
    path = tmp_path / "d.csv"
    path.write_text(text, encoding="utf-8")
    np.testing.assert_array_equal(directions.parse(str(path)), [[1, 0, 0], [0, 1, 0]])


def test_rows_of_any_length_keep_their_direction(tmp_path):
    path = tmp_path / "d.csv"
    path.write_text("x,y\n3e-200,4e-200\n3e200,4e200\n")
    np.testing.assert_allclose(directions.read_csv(path), [[0.6, 0.8], [0.6, 0.8]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y,z\n1,0,0\n0,one,0\n", 'line 3, column "y"'),
        ("x,y,z\n1,0,0\n\n0,1\n", "line 4 has 2 values"),
        ("x,y,z\n1,0,0\n0,0,0\n", "direction 2 is 0 along all axes"),
        ("1,0,0\n", 'column "x" is missing'),
        ("x,y,z\n", "broken"),
        ("", "broken"),
    ],
)
def test_bad_csv_names_the_file_and_the_row(tmp_path, text, message):
    path = tmp_path / "broken.csv"
    path.write_text(text)
    with pytest.raises(DataError, match=message) as caught:
        directions.read_csv(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    "text", ["grid19", "fibonacci", "fibonacci:", "fibonacci:x", "fibonacci:-3", "circle:1.5", ""]
)
def test_other_words_are_refused_with_the_choices(text):
    with pytest.raises(InputError, match="grid18, fibonacci:N, circle:N"):
        directions.parse(text)


def test_forces_of_a_platform_carry_no_torque():
    wrenches = directions.forces(directions.grid18(), components=6, dimension=3)
    np.testing.assert_array_equal(wrenches[:, :3], directions.grid18())
    assert not wrenches[:, 3:].any()


def test_directions_of_another_dimension_are_refused():
    with pytest.raises(ShapeError, match="circle:N"):
        directions.forces(directions.grid18(), components=3, dimension=2)
    with pytest.raises(ShapeError, match="grid18"):
        directions.forces(directions.circle(), components=3, dimension=3)
