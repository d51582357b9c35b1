import numpy as np

import tensionlab as tl
from tensionlab.plots import plot_rig


def test_a_flat_rig_has_a_flat_picture_with_all_of_it():
    flat, high = (plot_rig(tl.load_rig(name)) for name in ("floor-3", "body-mounted"))
    assert flat.get_figheight() < 0.7 * high.get_figheight()
    flat.canvas.draw()
    pixels = np.asarray(flat.canvas.buffer_rgba())[..., :3].min(axis=-1)
    rows = np.flatnonzero((pixels < 250).any(axis=1))
    assert np.diff(rows).max() < 0.6 * flat.dpi, "no white band"
    names = [text.get_text() for text in flat.axes[0].texts]
    assert names == ["floor-1", "floor-2", "floor-3"]
