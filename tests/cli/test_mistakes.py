"""Mistakes that a stranger makes on the command line, and what the line on stderr must say about each.

It names what was wrong, where, and what to do; nothing is written, and nothing is a traceback.
"""

import errno
import re
import shlex
import socket
import sys
from pathlib import Path

import pytest

from tests.helpers import runs
from tests.helpers.verbs import every_verb

RIG = (Path(__file__).parents[2] / "datasets" / "rigs" / "bartels2026-validation.toml").read_text()
MISTAKES = {
    # Words.
    "comprae cube-8": "no such command 'comprae'. Did you mean 'compare'? see `tensionlab -h`",
    "compare": "RIG is missing; see `tensionlab compare -h`",
    "compare cube-8 --plt c.png": "no such option: --plt (Possible options: --at, --plot, --policy); see `",
    "allocate cube-8": "--wrench is missing; see `tensionlab allocate -h`",
    "new": "is missing; see `tensionlab new -h`",
    "new rigg": "'rigg' is none of rig, space, scenario, program",
    "workspace cube-8 --view volumes": "--view: 'volumes' is not one of 'slices', 'volume', 'shares'",
    # Names.
    "allocate cube-8 --wrench 1 2 3 --frame hand 0 0 0": "no module has a frame, leave it out",
    "compare cube8": "no rig is called 'cube8'; did you mean 'cube-8'? A path ends in .toml",
    "scenario bw": "no scenario is called 'bw'; did you mean 'bow'?",
    "compare cube-8 --solvers newtn": "no solver is called 'newtn'; did you mean 'newton'?",
    "compare cube-8 --policy forces": "policy='forces' is unknown; choose one of force, tension, direction",
    "compare cube-8 --solvers dykstra --policy force": "does not support policy='force'; it supports 'tension'",
    "compare cube-8 --directions grid19": "'grid19': write grid18, fibonacci:N, circle:N or the path of a .csv",
    "workspace cube-8 --metric capacity-margins": "did you mean 'capacity-margin'?",
    "simulate rig.toml --only nobody": "--only nobody: no such module; there are floor-1, floor-2, floor-3, top",
    "module config set sim: slw=50": "no parameter \"slw\"; did you mean 'slew'?",
    "simulate rig.toml --fault left:encoder@2s": "--fault left:encoder@2s: no module 'left'; there are floor-1",
    # Numbers, and how many.
    "compare cube-8 --at 0 0": "--at has 2 components; cube-8 needs 3: x (m), y (m), z (m)",
    "compare cube-8 --at 0 0 nan": "--at is 0 0 nan; give finite numbers",
    "compare cube-8 --magnitude -1": "magnitude -1.0 is no size of a force; give newtons, finite and above 0",
    "compare body-mounted --frame hip 0": "--frame hip has 1 number; body-mounted needs 3 for the position",
    "allocate cube-8 --wrench 1 0": "--wrench has 2 components; cube-8 needs 3: Fx (N), Fy (N), Fz (N)",
    "allocate cube-8 --wrench one 0 0": "--wrench: 'one' is not a number; write --wrench 1 2 3 (in N)",
    "allocate cube-8 --wrench 1N 2N 3N": "--wrench: '1N' is not a number; write --wrench 1 2 3 (in N)",
    "workspace cube-8 --box 1 2 3": "--box has 3 numbers; cube-8 needs 6: x0 x1 y0 y1 z0 z1",
    "workspace cube-8 --step 0": "--step is 0; give one length in m, or 3, above zero",
    "workspace cube-8 --step 1e-5": "give out, a folder DIR.zarr",
    "workspace cogiro --rotations cone:-10": "a cone of -10 degrees with a step of 5; give angles above zero",
    "bench --out b --count 0": "--count: it is '0'; give 1 or more",
    "compare cube-8 --magnitude 1N": "--magnitude: it is '1N'; give a number",
    "bench --count many": "--count: it is 'many'; give a whole number",
    "simulate cube-8 --drop-pct 120": "--drop-pct: it is '120'; give 100 or less",
    "certify cube-8 --step -1": "--step is -1; give one length in m, or 3, above zero",
    "workspace cube-8 --step 0.1 0.1": "--step is 0.1 0.1; give one length in m, or 3, above zero",
    "workspace cube-8 --step 10cm": "--step: '10cm' is not a number; write --step 0.1 (in m)",
    "allocate cube-8 --wrench 1 2 3 --at 10cm 0 0": "--at: '10cm' is not a number; write --at 0 -0.1 0.3 (in m)",
    "run cube-8 --seconds 0": "--seconds: give a finite number above 0; got 0",
    "scenario bow --seconds 100": "--seconds is above 0 and at most 5; got 100",
    "validate --out v --hold 0": "each force is held for 0 s, of which 0.3 s are left out; hold longer than that",
    "module config set sim: slew=-50": "slew is from 10 to 300 N/s; got -50",
    "module calibrate gain sim: --mass 200": "--mass 200: give kg, above 0 and below 100",
    "serve cube-8 --port 99999": "--port: it is '99999'; give 65535 or less",
    # Options that do not go together, or lack another, or a value.
    "compare cube-8 --json --plot": "--plot needs a value; see `tensionlab compare -h`",
    "rig import --caspr rig.toml": "--caspr needs 2 values; see `tensionlab rig import -h`",
    "run cube-8 --on-loss ignore": "--on-loss: 'ignore' is not one of 'stop', 'continue'",
    "workspace cube-8 --step 1 --scheduler localhost": "missing port number in address 'localhost'); give one",
    "run cube-8 --force 1 2 3 --program program.toml": "--force and --program are both given; give one of them",
    "certify cube-8 --out a.zarr": "--out: a.zarr: unsupported format; it must end in .npz",
    "workspace cube-8 --poses poses.csv --step 1": "--poses takes the place of --box, --step and --rotations",
    "workspace cube-8 --rotations cone:10": "cannot turn; leave them out",
    "workspace cube-8 --poses poses.csv --plot w.png": "--plot draws a box",
    "validate rig.toml": "--out is missing",
    "validate --out v --sensor f.csv": "--sensor is of no use without --modules",
    "validate --out v --modules modules.toml --sensor f.csv --preset ideal": "--preset is for modules of",
    "scenario bow --modules socket://127.0.0.1:1": "have a tracker send /body/hand, /body/bow",
    "module config dump COM5 COM6": "more than one module; name one",
    "module config set COM5": "no parameters; write them like slew=50",
    "view": "give a rig to design, or --live for a run in progress",
    "validate --out v --modules modules.toml": "--modules needs --sensor: what do they pull on?",
    "scenario bow --osc 9000": "--osc is for real modules; the position of a simulated person is known",
    "serve": "give a rig, or --scenario NAME, which has a rig of its own",
    "serve cube-8 --host 0.0.0.0 --port 0": "give a token (--token-file)",
    # Rigs that do not suit the verb.
    "workspace cube-8 kntu-planar": "(planar) needs 2; give it other poses, or a sweep of its own",
    "scenario bow --rig kntu-planar": 'as rig "kntu-planar" (planar) has them, or another rig',
    "validate kntu-planar --out v": 'is of kind "planar"; the validation takes a point in space, kind "point"',
    # Modules that are not there.
    "module info COM5 COM5": "a module is there twice; give each once",
    "module info com5 COM5": "two of these links reach the same module; give each once",
    "module info m.toml": "m.toml is a modules file, not a link; give it as --modules m.toml",
    "view --live": "none of your processes has a run in progress; `run` and `serve` begin one",
    "simulate --listen 192.0.2.1": "cannot listen at 192.0.2.1",
    "module info": "no modules; give --modules FILE, or links: bt://AA:BB:CC:DD:EE:FF/1",
    "module info --modules modules.toml floor": "modules.toml has no module 'floor'; it has top",
    "module info socket://127.0.0.1:1": "cannot be opened: Connection refused; is it served there, and in reach?",
    "module monitor": "None of your tensionlab processes holds a module; name the modules to watch.",
    "run rig.toml --modules modules.toml": "no link for floor-1, floor-2, floor-3; give each module its own",
    "run rig.toml --modules sim:,sim:": "--modules has 2 links, bartels2026-validation has 4 modules",
    "serve cube-8 --port {port}": "port {port}: Address already in use; give another port, 0 for a free one",
    "run cube-8 --modules COM3": "--modules has 1 link, cube-8 has 8 modules",
    # Files that are not there, are not what is wanted, or are damaged.
    "trajectory cube-8 none.csv": "none.csv: no such file; give the path of a trajectory (*.csv)",
    "rig import --caspr none.xml rig.toml": "none.xml: no such file; give the path of an XML file",
    "compare none.toml": "none.toml: no such file; give the path of a rig file (*.toml)",
    "compare broken.toml": "broken.toml: not valid TOML: Unclosed array (at line 12, column 1); correct it",
    "compare key.toml": "key.toml: 2 problems: modules[3].name is missing; give a name in quotes",
    "workspace cube-8 --poses poses.csv": "poses.csv: line 2, column \"z\": 'nan' is no finite number",
    "rig import --caspr rig.toml rig.toml": "rig.toml: not well-formed XML",
    "module calibrate anchors rig.toml heads.csv": 'heads.csv: column "floor-1" is missing; there are',
    # Places that cannot be written to.
    "compare cube-8 --plot c.bmp": "--plot: c.bmp: unsupported format; it must end in .png or .pdf or .svg",
    "compare cube-8 --out no/such/c.csv": "no folder",
    "log export run.mcap --out run.txt": "it must end in .nc or .parquet or .csv",
    "workspace cube-8 --out a.csv": "--out: a.csv: the name must end in .zarr",
    "run cube-8 --log run.mcap": "--log: run.mcap: there is something already; name a new file for the log",
    "new rig --out rig.toml": "rig.toml: there is something already; name a new file for the rig",
    "bench --out run.mcap": "--out: run.mcap: cannot be written (Not a directory); name a place in a folder",
}  # what the line on stderr must say, by command
NO = {"module info socket://127.0.0.1:1", "module monitor", "view --live"}  # well-formed: the answer is no
MISSING = {
    "workspace cube-8 --step 1 --out a.zarr": ("zarr", 'a store needs zarr: pip install "tensionlab[workspace]"'),
    "workspace cube-8 --scheduler tcp://127.0.0.1:1": (
        "distributed",
        'a cluster needs distributed: pip install "tensionlab[cluster]"',
    ),
    "serve cube-8 --port 0 --seconds 0.1": ("websockets", 'pip install "tensionlab[haptics]"'),
    "view cube-8 --no-browser": ("viser", 'the view needs viser: pip install "tensionlab[view]"'),
}  # a library that is not installed, and what must be said, by command


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with files to be mistaken about."""
    folder = tmp_path_factory.mktemp("mistakes")
    texts = {
        "rig.toml": RIG,
        "broken.toml": RIG.replace("[", "[[", 1),
        "key.toml": RIG.replace('name = "top"', 'nam = "top"'),
        "program.toml": 'name = "program"\n[[steps]]\nseconds = 1.0\nwrench = [0.0, 1.0, 0.0]\n',
        "modules.toml": '[modules]\ntop = "sim:"\n',
        "poses.csv": "x,y,z\n0,0,nan\n",
        "heads.csv": "a,b,c\n1,2,3\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    runs.logged(folder / "run.mcap", runs.four(), 4)
    return folder


@pytest.fixture(scope="module")
def port():
    """A port that is in use."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield listening.getsockname()[1]


@pytest.fixture
def mistaken(run, folder, monkeypatch, locks_folder):
    """Run a command that must be refused, and return the last line on stderr: nothing is written."""

    def contents():
        return {path: path.is_file() and path.read_bytes() for path in folder.rglob("*")}

    def call(command, status):
        monkeypatch.chdir(folder)
        before = contents()
        code, _, err = run(*shlex.split(command))
        assert (code, contents()) == (status, before)
        *told, line = err.splitlines()
        assert len(told) <= 1, err  # that modules are simulated, or how large a sweep is
        assert line.startswith("tensionlab: ")
        assert len(line) <= 300
        assert not re.search(r"Traceback|\.py\b|Errno", line)
        return line

    return call


@pytest.mark.parametrize("command", MISTAKES)
def test_a_mistake_is_named_with_its_cure(mistaken, port, command):
    line = mistaken(command.format(port=port), 1 if command in NO else 2)
    assert MISTAKES[command].format(port=port) in line


def test_an_option_with_one_value_is_there_once_for_every_verb(run):
    tried = 0
    for words, verb in every_verb():
        for each in verb.params:
            if each.param_type_name != "option" or each.multiple or (each.is_flag and not each.secondary_opts):
                continue
            name, *others = [*each.opts, *each.secondary_opts]
            again = [name, *(others[-1:] or [name])] if each.is_flag else [name, *["1"] * each.nargs] * 2
            status, out, err = run(*words.split(), *again)
            assert (status, out) == (2, "")
            assert err.endswith(f"{max(each.opts, key=len)}: it is there twice; give it once\n"), (words, err)
            tried += 1
    assert tried > 130
    assert run("solvers", "--json", "--json")[0] == 0


@pytest.mark.parametrize("command", MISSING)
def test_a_library_that_is_not_installed_is_named_with_its_extra(mistaken, monkeypatch, command):
    library, said = MISSING[command]
    for name in [library, *(name for name in sys.modules if name.startswith(f"{library}."))]:
        monkeypatch.setitem(sys.modules, name, None)
    assert said in mistaken(command, 2)


def test_a_file_that_may_not_be_read_is_named(mistaken, monkeypatch):
    opened = Path.open

    def refuse(path, *words, **options):  # permissions do not stop who runs as root
        if path.name == "secret.toml":
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return opened(path, *words, **options)

    monkeypatch.setattr(Path, "open", refuse)
    said = "tensionlab: secret.toml: cannot be read (Permission denied); give a rig file (*.toml)"
    assert mistaken("compare secret.toml", 2) == said
