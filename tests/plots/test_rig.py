import numpy as np

import tensionlab as tl
from tensionlab.haptics.brakes.choice import brake_map
from tensionlab.plots.rig import map_normals, plot_brake_maps, plot_rig
from tensionlab.plots.style import save_figure


def test_a_flat_rig_has_a_flat_picture_with_all_of_it():
    flat, high = (plot_rig(tl.load_rig(name)) for name in ("floor-3", "body-mounted"))
    assert flat.get_figheight() < 0.7 * high.get_figheight()
    flat.canvas.draw()
    pixels = np.asarray(flat.canvas.buffer_rgba())[..., :3].min(axis=-1)
    rows = np.flatnonzero((pixels < 250).any(axis=1))
    assert np.diff(rows).max() < 0.6 * flat.dpi, "no white band"
    names = [text.get_text() for text in flat.axes[0].texts]
    assert names == ["floor-1", "floor-2", "floor-3"]


def test_the_map_of_brakeable_directions(tmp_path):
    rig = tl.load_rig("datasets/rigs/floor-3.toml")
    U, normals = rig.structure_matrix(rig.home), map_normals()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    maps = {
        "Motors": brake_map(U, normals, 50.0, rig.limits, np.zeros(3)),
        "Motors and brakes": brake_map(U, normals, 50.0, rig.limits, np.full(3, 186.0)),
    }
    for name in ("one.png", "two.png"):
        save_figure(plot_brake_maps(maps, U), tmp_path / name)
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
