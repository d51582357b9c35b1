"""Published robots, written out as CASPR writes them, come back with the structure matrices of their numbers."""

import json
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from tensionlab.errors import RigError
from tensionlab.interop.caspr import load_caspr
from tensionlab.model import kinematics
from tensionlab.model.files import load_rig, rig_from_toml, rig_to_toml

ROOT = Path(__file__).parents[2]
ROBOTS = json.loads((ROOT / "tests/data/geometries.json").read_text(encoding="utf-8"))["robots"]
# Sets of cables between two points, without pulleys.
SETS = [
    (robot, name)
    for robot, numbers in ROBOTS.items()
    for name, cables in numbers["cable_sets"].items()
    if all(len(cable["att"]) == 2 for cable in cables)
]


def bodies_xml(bodies):
    """A file of bodies as CASPR has it."""
    links = ""
    for number, body in enumerate(bodies, start=1):
        joint = " ".join(f"{key}={quoteattr(value)}" for key, value in body["joint"].items())
        moments = "".join(f"<{key}>{value}</{key}>" for key, value in body["I"].items())
        links += f"""
      <link_rigid num="{number}" name={quoteattr(body["name"])}>
        <joint {joint}/>
        <physical>
          <mass>{body["mass"]}</mass>
          <com_location>{body["com"]}</com_location>
          <end_location>0.0 0.0 0.0</end_location>
          <inertia ref="{body.get("ref", "com")}">{moments}</inertia>
        </physical>
        <parent>
          <num>{number - 1}</num>
          <location>{body.get("parent", "0.0 0.0 0.0")}</location>
        </parent>
      </link_rigid>"""
    return f"""<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE bodies_system SYSTEM "../../../../templates/bodies.dtd">
<bodies_system>
    <links display_range="-5 5 -4 4 -0.5 6" view_angle="-37 32">{links}
    </links>
</bodies_system>"""


def cables_xml(sets, default):
    """A file of cables as CASPR has it."""
    text = ""
    for name, cables in sets.items():
        text += f'\n  <cable_set id="{name}">'
        for cable in cables:
            ends = "".join(
                f"<attachment><link>{link}</link><location>{' '.join(map(repr, place))}</location></attachment>"
                for link, place in cable["att"]
            )
            text += f"""
    <cable_ideal name="{cable["name"]}" attachment_reference="{cable["ref"]}">
      <properties><force_min>{cable["fmin"]}</force_min><force_max>{cable["fmax"]}</force_max></properties>
      <attachments>{ends}</attachments>
    </cable_ideal>"""
        text += "\n  </cable_set>"
    return f"""<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE cables SYSTEM "../../../../templates/cables.dtd">
<cables default_cable_set="{default}">{text}
</cables>"""


@pytest.fixture
def write(tmp_path):
    """A pair of files from a robot's numbers, or from text."""

    def written(bodies, cables):
        paths = tmp_path / "robot_bodies.xml", tmp_path / "robot_cables.xml"
        for path, text in zip(paths, (bodies, cables), strict=True):
            path.write_text(text, encoding="utf-8")
        return paths

    return written


def robot_files(write, robot):
    numbers = ROBOTS[robot]
    sets = {name: cables for name, cables in numbers["cable_sets"].items() if (robot, name) in SETS}
    return write(bodies_xml(numbers["bodies"]), cables_xml(sets, numbers["default"]))


@pytest.mark.parametrize(("robot", "cable_set"), SETS)
def test_the_structure_matrices_are_those_of_the_numbers(write, robot, cable_set):
    rig = load_caspr(*robot_files(write, robot), cable_set)
    body = ROBOTS[robot]["bodies"][0]
    cables = ROBOTS[robot]["cable_sets"][cable_set]
    axes = {"P_XZ": [0, 2], "PLANAR_XY": [0, 1]}.get(body["joint"]["type"], [0, 1, 2])
    anchors, attachments = (np.array([cable["att"][end][1] for cable in cables])[:, axes] for end in (0, 1))
    com = np.array(body["com"].split(), dtype=float)[axes]
    attachments = attachments + [com if cable["ref"] == "com" else 0 * com for cable in cables]
    start = np.array(body["joint"]["q_initial"].split(), dtype=float)
    np.testing.assert_array_equal(rig.home, start[: len(axes)])
    rng = np.random.default_rng(2)
    position = rig.home + 0.05 * np.ptp(anchors, axis=0).max() * rng.uniform(-1, 1, size=len(axes))
    rotation, matrix = None, np.eye(len(axes))
    if rig.kind == "planar":
        rotation = 0.2
        matrix = Rotation.from_rotvec([0, 0, rotation]).as_matrix()[:2, :2]
    elif rig.kind == "platform":
        rotation = matrix = Rotation.from_rotvec(rng.uniform(-0.2, 0.2, size=3)).as_matrix()
    arms = attachments @ matrix.T
    _, directions = kinematics.cables(anchors, position, arms)
    expected = kinematics.structure_matrix(directions, arms if rig.n > rig.dimension else None)
    np.testing.assert_allclose(rig.structure_matrix(position, rotation), expected, atol=1e-14)
    if robot != "MACARM":  # whose last cable is called "1" again
        assert [module.name for module in rig.modules] == [cable["name"] for cable in cables]
    assert rig.limits.lower.tolist() == [float(cable["fmin"]) for cable in cables]
    assert rig.limits.upper.tolist() == [float(cable["fmax"]) for cable in cables]
    assert rig_from_toml(rig_to_toml(rig), "again") == rig


@pytest.mark.parametrize("robot", ["IPAnema_1", "IPAnema_2", "CoGiRo", "CAROCA", "FAST", "KNTU_planar"])
def test_the_rigs_of_the_repository_are_what_is_imported(write, robot):
    name = robot.lower().replace("_", "-")
    imported, ours = load_caspr(*robot_files(write, robot)), load_rig(ROOT / "datasets" / "rigs" / f"{name}.toml")
    np.testing.assert_array_equal(imported.anchors, ours.anchors)
    np.testing.assert_array_equal(imported.attachments, ours.attachments)
    if name == "fast":
        assert imported.home.tolist() == [0.0, 0.0, 100.0]  # where the minimum tensions lift the cabin
    else:
        np.testing.assert_array_equal(imported.home, ours.home)
    assert imported.required.gravity == (imported.up is not None)
    assert imported.limits.upper.tolist() == ours.limits.upper.tolist()
    assert imported.platform.mass == ours.platform.mass
    np.testing.assert_array_equal(imported.platform.inertia, ours.platform.inertia)


BODY = {
    "name": "plate",
    "joint": {"type": "SPATIAL_EULER_XYZ", "q_initial": "1 2 3 0 0 0"},
    "mass": "2",
    "com": "0.1 0.2 0.3",
    "I": {"Ixx": "1", "Iyy": "2", "Izz": "2.5", "Ixy": "0.1", "Ixz": "0.2", "Iyz": "0.3"},
}
CABLE = {"name": "a", "ref": "joint", "fmin": "1", "fmax": "9", "att": [["0", [4, 0, 5]], ["1", [0.5, 0, 0]]]}


def model(write, body=(), *cables):
    return write(bodies_xml([{**BODY, **dict(body)}]), cables_xml({"s": cables or [CABLE]}, "s"))


def test_references_and_bases_move_attachments_and_home_and_equal_names_are_told_apart(write):
    rig = load_caspr(*model(write, {"parent": "10 20 30"}, CABLE, {**CABLE, "name": "b", "ref": "com"}, CABLE))
    np.testing.assert_allclose(rig.attachments, [[0.5, 0, 0], [0.6, 0.2, 0.3], [0.5, 0, 0]], atol=1e-15)
    assert rig.anchors.tolist() == [[4, 0, 5]] * 3
    assert [module.name for module in rig.modules] == ["a", "b", "a (3)"]
    assert rig.home.tolist() == [11, 22, 33]


def test_the_plane_in_which_a_body_moves_goes_through_its_base(write):
    body = {"joint": {"type": "PLANAR_XY", "q_initial": "1 2 0"}, "com": "0 0 0", "parent": "0 0 0.5"}
    cables = [{**CABLE, "att": [["0", [4, 3, z]], ["1", [0.1, 0.2, 0]]]} for z in (0.5, -0.5)]
    assert load_caspr(*model(write, body, cables[0])).anchors.tolist() == [[4, 3]]
    with pytest.raises(RigError, match="leaves the xy plane in which the body moves"):
        load_caspr(*model(write, body, cables[1]))


def test_inertia_about_the_joint_is_moved_to_the_centre_of_mass(write):
    about_com = load_caspr(*model(write)).platform.inertia
    com = np.array([0.1, 0.2, 0.3])
    extra = 2 * (com @ com * np.eye(3) - np.outer(com, com))  # of two kilograms there, about the joint
    moved = {key: repr(float((about_com + extra)["xyz".index(key[1]), "xyz".index(key[2])])) for key in BODY["I"]}
    about_joint = load_caspr(*model(write, {"ref": "joint", "I": moved}))
    np.testing.assert_allclose(about_joint.platform.inertia, about_com, atol=1e-12)


@pytest.mark.parametrize(("joint", "torque"), [("PLANAR_XY", 1), ("PLANAR_YZ", 1), ("PLANAR_XZ", -1)])
def test_planes_keep_forces_and_torques(write, joint, torque):
    """The rig's torque is about the axis that its description names."""
    axes = ["xyz".index(axis) for axis in joint[-2:].lower()]
    normal = np.delete([0, 1, 2], axes)[0]
    far, near, place = np.zeros((3, 3))
    far[axes], near[axes], place[axes] = [4, 3], [0.1, 0.2], [1, 2]
    cable = {**CABLE, "att": [["0", far.tolist()], ["1", near.tolist()]]}
    body = {"joint": {"type": joint, "q_initial": "1 2 0"}, "com": "0 0 0"}
    rig = load_caspr(*model(write, body, cable))
    assert rig.home.tolist() == [1, 2]
    W = rig.structure_matrix(rig.home)
    u = (far - place - near) / np.linalg.norm(far - place - near)
    np.testing.assert_allclose(W[:2, 0], u[axes], atol=1e-14)
    np.testing.assert_allclose(W[2, 0], torque * np.cross(near, u)[normal], atol=1e-14)
    assert f"torques are about {'+' if torque > 0 else '-'}{'xyz'[normal]}" in rig.description
    assert rig.platform.inertia.item() == float(BODY["I"][f"I{'xyz'[normal]}{'xyz'[normal]}"])


def test_a_body_that_cannot_turn_is_a_point_where_its_cables_end(write):
    body = {"joint": {"type": "T_XYZ", "q_initial": "1 2 3"}}
    other = {**CABLE, "name": "b", "att": [["1", [0.5, 0, 0]], ["0", [0, 0, 9]]]}
    rig = load_caspr(*model(write, body, CABLE, other))
    assert rig.kind == "point"
    assert rig.home.tolist() == [1.5, 2, 3]
    assert rig.anchors.tolist() == [[4, 0, 5], [0, 0, 9]]
    elsewhere = {**CABLE, "name": "b", "att": [["0", [0, 0, 9]], ["1", [0, 0.1, 0]]]}
    with pytest.raises(RigError, match="'b': ends elsewhere than the first cable"):
        load_caspr(*model(write, body, CABLE, elsewhere))


def test_a_body_that_turns_about_a_fixed_point_is_spherical(write):
    angles = [0.3, -0.2, 0.5]
    body = {"joint": {"type": "S_EULER_XYZ", "q_initial": "0.3 -0.2 0.5"}, "parent": "0 0 1"}
    other = {**CABLE, "name": "b", "ref": "com", "att": [["0", [0, 4, 3]], ["1", [0.1, 0.2, 0]]]}
    rig = load_caspr(*model(write, body, CABLE, other))
    assert (rig.kind, rig.n) == ("spherical", 3)
    assert rig.home.tolist() == [0, 0, 1]
    x, y, z = (Rotation.from_euler(axis, angle).as_matrix() for axis, angle in zip("xyz", angles, strict=True))
    R = x @ y @ z
    np.testing.assert_allclose(rig.home_matrix, R, atol=1e-14)
    for column, (anchor, arm) in enumerate([([4, 0, 5], [0.5, 0, 0]), ([0, 4, 3], [0.2, 0.4, 0.3])]):
        pull = anchor - (np.array([0, 0, 1]) + R @ arm)
        moment = np.cross(R @ arm, pull / np.linalg.norm(pull))
        np.testing.assert_allclose(rig.structure_matrix(rig.home)[:, column], moment, atol=1e-14)
    weight = np.cross(R @ [0.1, 0.2, 0.3], [0, 0, -2 * 9.81])
    np.testing.assert_allclose(rig.weight, weight, atol=1e-13)


def test_elastic_cables_and_passive_springs_are_told_of(write):
    bodies, cables = model(write, (), CABLE, {**CABLE, "name": "soft"}, {**CABLE, "name": "spring 0"})
    text = cables.read_text()
    for name, tag in (("soft", "cable_linear_spring"), ("spring 0", "cable_passive_linear_spring")):
        before, after = text.split(f'<cable_ideal name="{name}"')
        text = f'{before}<{tag} name="{name}"{after.replace("</cable_ideal>", f"</{tag}>", 1)}'
    cables.write_text(text)
    rig = load_caspr(bodies, cables)
    assert [module.name for module in rig.modules] == ["a", "soft"]
    assert "elastic cables are stiff" in rig.description
    assert "passive springs (spring 0)" in rig.description


REFUSED = {
    "another joint": ("bodies", "SPATIAL_EULER_XYZ", "U_XY", r'<joint>: .* "type" is'),
    "no joint": ("bodies", "<joint type", "<hinge type", r"<link_rigid> 'plate': has no elements <joint>"),
    "no coordinates": ("bodies", "q_initial", "q_start", r'attribute "q_initial" is missing'),
    "no mass": ("bodies", "<mass>2", "<mass>heavy", r"<mass>: its text is 'heavy'; give 1 finite number"),
    "negative mass": ("bodies", "<mass>2", "<mass>-2", r'"mass" is -2'),
    "other file": ("bodies", "bodies_system", "robots", r"root element must be <bodies_system>"),
    "broken": ("bodies", "</links>", "", r"not well-formed XML: .*line"),
    "unknown entity": ("bodies", "<mass>2", "<mass>&two;", r"undefined entity &two;: line 8"),
    "default set that is not there": ("cables", 'set="s"', 'set="t"', r"no <cable_set> with the id 't'; .* are s"),
    "no reference": ("cables", ' attachment_reference="joint"', "", r"'a': attribute .attachment_reference. is"),
    "muscle": ("cables", "cable_ideal", "muscle_hill_type", r"<muscle_hill_type> 'a': no cable of a rig"),
    "two locations": ("cables", "<link>1</link>", "<link>1</link><location/>", r"2 elements <location>"),
    "flat location": ("cables", "4 0 5", "4 0", r"<location>: its text is '4 0'; give 3 finite numbers"),
    "second link": ("cables", "<link>1</link>", "<link>2</link>", r"two attachments, to the links 0 and 1"),
    "limits the wrong way round": ("cables", "<force_min>1<", "<force_min>10<", r'"a".*"lower" is 10'),
}  # fmt: skip


@pytest.mark.parametrize("change", REFUSED.values(), ids=REFUSED)
def test_errors_name_the_file_the_element_and_the_attribute(write, change):
    which, old, new, message = change
    files = dict(zip(("bodies", "cables"), model(write), strict=True))
    text = files[which].read_text()
    assert old in text
    files[which].write_text(text.replace(old, new))
    with pytest.raises(RigError, match=message) as caught:
        load_caspr(*files.values())
    if "mass" not in message and "lower" not in message:
        assert str(caught.value).startswith(str(files[which]))


def over(write, tag="base_rotating_pulley", body=()):
    """A model whose cable goes over a pulley of 45 mm, which it comes to upwards."""
    bodies, cables = model(write, body)
    pulley = (
        f"<{tag}><fixed_location>4 0 5</fixed_location><pulley_radius>0.045</pulley_radius>"
        f"<cable_entry_vector>0 0 2</cable_entry_vector></{tag}>"
    )
    text = cables.read_text()
    start, end = text.index("<attachment>"), text.index("</attachment>") + len("</attachment>")
    cables.write_text(text[:start] + pulley + text[end:])
    return bodies, cables


def test_pulleys_are_those_of_caspr(write):
    """By its construction: the centre, the point where the cable leaves, and the arc by the angle between them."""
    rig = load_caspr(*over(write))
    assert [(module.pulley_radius, module.pulley_axis.tolist()) for module in rig.modules] == [(0.045, [0, 0, 2])]
    rng = np.random.default_rng(0)
    for _ in range(20):
        position = rig.home + rng.uniform(-1, 1, 3)
        enters, end, entry = np.array([4.0, 0, 5]), position + np.array([0.5, 0, 0]), np.array([0.0, 0, 2])
        normal = np.cross(entry, end - enters)
        normal /= np.linalg.norm(normal)
        outward = np.cross(normal, entry)
        centre = enters + 0.045 * outward / np.linalg.norm(outward)
        ratio = 0.045 / np.linalg.norm(end - centre)
        leaves = centre + ratio**2 * (end - centre)
        leaves -= ratio * np.sqrt(1 - ratio**2) * np.cross(normal, end - centre)
        angle = np.arccos((enters - centre) @ (leaves - centre) / 0.045**2)
        length = 0.045 * angle + np.linalg.norm(end - leaves)
        assert rig.lengths(position)[0] == pytest.approx(length, rel=1e-12)
        direction = (leaves - end) / np.linalg.norm(leaves - end)
        np.testing.assert_allclose(rig.cables(position).directions[0], direction, atol=1e-12)


def test_other_pulleys_other_planes_and_several_bodies_are_refused(write):
    with pytest.raises(RigError, match=r"<screw_base_rotating_pulley>: no attachment of a rig"):
        load_caspr(*over(write, "screw_base_rotating_pulley"))
    plane = {"joint": {"type": "PLANAR_XY", "q_initial": "0 0 0"}, "com": "0 0 0"}
    with pytest.raises(RigError, match="leaves the xy plane"):
        load_caspr(*over(write, body=plane))
    bodies, cables = write(bodies_xml([BODY, BODY]), cables_xml({"s": [CABLE]}, "s"))
    with pytest.raises(RigError, match="2 bodies; a rig has one"):
        load_caspr(bodies, cables)


def test_files_that_cannot_be_read_are_named(write, tmp_path):
    bodies, cables = model(write)
    with pytest.raises(RigError, match=r"missing\.xml: no such file"):
        load_caspr(tmp_path / "missing.xml", cables)
    for encoding in ("martian", "utf-7", "shift_jis", "utf-32"):  # unknown, or several bytes a character
        bodies.write_bytes(f'<?xml version="1.0" encoding="{encoding}"?><bodies_system/>'.encode())
        with pytest.raises(RigError, match="not well-formed XML"):
            load_caspr(bodies, cables)
    for text, message in (
        ("<bodies_system>" * 5000 + "</bodies_system>" * 5000, "has no elements <links>"),
        (f"<bodies_system>{'x' * 2_000_000}</bodies_system>", "has more than 1,000,000 bytes"),
        ("\0\1", "not well-formed XML"),
        (
            '<!DOCTYPE b [<!ENTITY f SYSTEM "/etc/host">]><bodies_system>&f;</bodies_system>',
            "undefined entity",
        ),
    ):
        bodies.write_text(text)
        with pytest.raises(RigError, match=message):
            load_caspr(bodies, cables)


# From rest to rest in 1 s: x, y in m and the angle in rad.
START, END = np.array([0.3, 0.8, 0.1]), np.array([0.7, 0.2, -0.2])


@pytest.mark.parametrize(
    ("published", "solver"),
    [("two-norm", "newton"), ("two-norm", "minimax"), ("improved-closed-form", "closed-form")],
)
def test_tensions_are_those_that_caspr_published(published, solver):
    """Figure 5 of Lau, Eden, Tan and Oetomo, IROS 2016, of the planar robot of K. N. Toosi University.

    It is a vector drawing in CASPR's repository (docs/papers/16_IROS_CASPR.pdf), with a corner of each curve every
    10 ms; the file has them in units of the axes. The drawing has them to 0.4 mN, the file to 1 mN.
    """
    rig, table = load_rig("kntu-planar"), pd.read_csv(ROOT / "tests/data/caspr_2016_figure_5.csv")
    curves = table[table["solver"] == published].groupby("cable")
    assert set(curves.groups) == {1, 2, 3, 4}
    path = tl.Trajectory.through([START[:2], END[:2]], [0.0, 1.0], [START[2], END[2]], step=1e-3)
    for cable, curve in curves:
        t = curve["time_s"].to_numpy()
        assert len(t) > 50
        samples = np.searchsorted(path.times, t - 1e-9)
        structure = rig.structure_matrix(path.position, path.rotation)[samples]
        wrenches = tl.inverse_dynamics(rig, path)[samples]
        found = tl.allocate(structure, wrenches, rig.limits, solver)
        assert (found.status == tl.Status.EXACT).all()
        np.testing.assert_allclose(found.tensions[:, cable - 1], curve["tension_N"], rtol=0, atol=1e-3)


def square(lower, upper):
    """The planar robot of CASPR's tutorials: a body of 10 kg between the corners of a square metre."""
    corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    modules = tuple(
        tl.Module(f"cable {number}", corner, lower, upper, attachment=[0.25 * corner[0] - 0.125, 0.0])
        for number, corner in enumerate(corners, start=1)
    )
    return tl.Rig("square", "planar", modules, home=[0.5, 0.5], platform=tl.Platform(10.0, inertia=[[10.0]]))


@pytest.mark.parametrize(
    ("solver", "name", "x", "pixel_N"),
    [
        ("newton", "quintic", [0.3, 0.7], 0.0205),
        ("closed-form", "quintic", [0.3, 0.7], 0.066),
        ("newton", "infeasible", [0.3, 1.0, 0.3], 0.103),
    ],
)
def test_inverse_dynamics_along_its_quintics_are_those_of_caspr_s_tutorial(solver, name, x, pixel_N):
    """Tutorial 5 of CASPR's repository, whose figures have a dot for each cable every 50 ms, read to a pixel.

    They were drawn when the cables of the model took 10 to 100 N. Dots at the edge of a figure are left out.
    """
    rig, table = square(10.0, 100.0), pd.read_csv(ROOT / "tests/data/caspr_tutorial_5.csv")
    points, times = [[each, 0.5] for each in x], np.linspace(0.0, 5.0, len(x))
    path = tl.Trajectory.through(points, times, np.zeros(len(x)), step=0.05)
    structure = rig.structure_matrix(path.position, path.rotation)
    found = tl.allocate(structure, tl.inverse_dynamics(rig, path), rig.limits, solver)
    dots = table[(table["solver"] == solver) & (table["path"] == name)]
    own = found.tensions[np.rint(dots["time_s"] / 0.05).astype(int)]
    misses = abs(own - dots["tension_N"].to_numpy()[:, None]).min(axis=1)
    assert len(dots) > 98
    assert misses.max() < pixel_N
    unreachable = path.times[~found.exact]
    if name == "infeasible":  # as the log in the tutorial says, too
        np.testing.assert_allclose(unreachable, np.arange(33, 68) * 0.05, atol=1e-9)
    else:
        assert not len(unreachable)


def test_its_static_closure_and_wrench_feasible_poses_are_those_of_caspr_s_tutorial():
    """Tutorial 8, part 1: a point of 5 kg on three cables; the file has the columns of dots of three figures."""
    anchors = ([0.0, 0.0], [1.0, 2.0], [2.0, 0.0])
    modules = tuple(tl.Module(f"cable {i}", place, 0.001, 100.0) for i, place in enumerate(anchors, start=1))
    rig = tl.Rig("point", "planar-point", modules, home=[1.0, 1.0], platform=tl.Platform(5.0), up="y")
    grid = tl.workspace.Grid(0.05 * np.arange(1, 40), -2.0 + 0.05 * np.arange(80))
    table = pd.read_csv(ROOT / "tests/data/caspr_tutorial_8.csv")
    for name, metric, required, count in (
        ("static", "wrench-feasible", tl.Requirement(gravity=True), 2186),
        ("wrench-closure", "wrench-closure", None, 761),
        ("wrench-feasible", "wrench-feasible", tl.Requirement(gravity=True, box=[20.0, 20.0]), 894),
    ):
        found = tl.sweep(rig, grid, [metric], required=required)[metric].to_numpy().reshape(39, 80) > 0.0
        published = np.zeros_like(found)
        for _, x, lowest, highest in table[table["set"] == name].itertuples(index=False):
            published[round(x / 0.05) - 1, round((lowest + 2.0) / 0.05) : round((highest + 2.0) / 0.05) + 1] = True
        assert published.sum() == count
        np.testing.assert_array_equal(found, published)
