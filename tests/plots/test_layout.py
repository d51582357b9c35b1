import tensionlab as tl
from tensionlab.plots import plot_search
from tensionlab.support.colours import ORANGE


def test_a_search_is_drawn_with_its_target_and_a_front_of_several_counts():
    hand = tl.workspace.box([-0.2, 0.2], [1.0, 1.4], [-0.2, 0.2], step=0.4)
    for counts, panels in (((4,), 2), ((4, 5), 3)):
        space = tl.workspace.Space(tl.workspace.room([3.0, 2.4, 4.0]), counts=counts, up="y")
        found = tl.workspace.search_layout(space, hand, tl.workspace.Objective(), generations=1, starts=1)
        figure = plot_search(space, hand, found)
        assert len(figure.axes) == panels
        for axes in figure.axes[:2]:
            edges = [
                line for line in axes.get_lines() if line.get_color() == ORANGE and line.get_linestyle() == "-"
            ]
            assert len(edges) == 12  # of the target
    assert [line.get_xdata()[-1] for line in figure.axes[2].get_lines()] == [5, found.front[-1].rig.m]
