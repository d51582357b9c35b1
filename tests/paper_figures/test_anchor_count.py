import re

import numpy as np

from paper_figures.anchor_count import ROOM, plot_anchor_count, room_rigs, sweep_published, sweep_room
from tensionlab.plots.style import save_figure
from tensionlab.plots.workspace import read_field, share_above


def test_three_to_eight_modules_stand_on_the_walls_of_the_room():
    rigs = room_rigs()
    assert [rig.m for rig in rigs] == [3, 4, 5, 6, 7, 8]
    for rig in rigs:
        assert rig.name.startswith(f"{rig.m}: ")
        inside = rig.anchors + np.array([ROOM[0] / 2, 0.0, ROOM[2] / 2])
        assert (inside >= 0).all()
        assert (inside <= ROOM).all()
        assert np.isin(rig.anchors[:, 1], (0.0, ROOM[1])).all()
        assert len(np.unique(rig.anchors, axis=0)) == rig.m


def test_the_figure_shows_all_rigs_and_what_more_modules_buy(tmp_path):
    room, published = sweep_room(13), sweep_published(9)
    shares = [float(share_above(read_field(room), number, 1.0)[0]) for number in range(6)]
    assert shares[0] == 0.0  # three modules on the floor pull nothing up
    assert shares == sorted(shares)
    assert shares[-1] > 0.4
    save_figure(plot_anchor_count(published, room), tmp_path / "a.svg")
    words = re.findall(r"<!-- (.*?) -->", (tmp_path / "a.svg").read_text(encoding="utf-8"))
    for name in ("bartels2026-validation", "cube-8", "spidar-big, 4 wires", "spidar-big, 8 wires"):
        assert name in words
    assert all(rig.name in words for rig in room_rigs())
