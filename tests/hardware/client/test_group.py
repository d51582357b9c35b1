"""Groups of modules, and the file that names the modules of a rig and their links."""

import pytest

import tensionlab as tl
from tensionlab.errors import HardwareError
from tensionlab.hardware.client.group import ModuleGroup, load_modules, modules_to_toml
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.simulation.links import Conditions, FaultyLink, SimulatedLink
from tensionlab.hardware.simulation.world import World


def test_what_is_written_is_read_again(tmp_path):
    links = {"floor-1": "socket://127.0.0.1:40001", "x- y+": "/dev/rfcomm0", "ü": "COM5"}
    file = tmp_path / "modules.toml"
    file.write_text(modules_to_toml(links), encoding="utf-8")
    assert list(load_modules(file).items()) == list(links.items())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[modules", "not valid TOML"),
        ("", r"no modules; write \[modules\]"),
        ("[modules]", "no modules"),
        ('modules = "COM5"', "no modules"),
        ('[module]\na = "COM5"', 'unknown key "module"; the file has one table'),
        ("[modules]\na = 5", '"a" is 5; give a link as text'),
        ('[modules]\na = ""', "\"a\" is ''"),
        ('[modules]\na = "COM5"\nb = "COM5"', "COM5 is there twice"),
    ],
)
def test_what_is_wrong_is_named_with_its_file(tmp_path, text, message):
    file = tmp_path / "modules.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(HardwareError, match=message) as found:
        load_modules(file)
    assert "modules.toml" in str(found.value)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(HardwareError, match=r"none\.toml: no such file"):
        load_modules(tmp_path / "none.toml")


def test_modules_stay_armed_while_one_is_slow_to_answer_however_fast_this_machine_simulates():
    """They release after 0.25 s of their own time without a set-point, which may be a few ms of the host's."""
    rig = tl.load_rig("datasets/rigs/bartels2026-validation.toml")
    world = World(rig)
    links = [SimulatedLink(module) for module in world.modules]
    slow = FaultyLink(links[-1], Conditions(latency=0.2))
    clients = [
        ModuleClient(module.name, link) for module, link in zip(rig.modules, [*links[:-1], slow], strict=True)
    ]
    group = ModuleGroup(clients)
    begin = links[0].clock()
    group.arm([1.0] * rig.m)
    assert links[0].clock() - begin > 0.3
    for client in clients[:-1]:
        client.listen(0.02)
        assert client.state is State.ARMED
