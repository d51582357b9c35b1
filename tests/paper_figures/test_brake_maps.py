import numpy as np

import tensionlab as tl
from paper_figures.brake_maps import map_normals, plot_brake_maps
from tensionlab.haptics.rendering.brakes import brake_map
from tensionlab.plots.style import save_figure


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
