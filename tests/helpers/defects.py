"""Modules with a defect: the firmware on simulated hardware, in processes of their own, reached over TCP."""

import socket
import struct
import subprocess

from firmware import dangers
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.protocol.messages import Acknowledge, Decoder, Event, Info, Telemetry, read

STEP_US = 5000


def compile_programs(folder):
    """Make `dangers`, which plays all dangers, and `served`, which serves a module with a defect."""
    objects = dangers.compile_firmware(folder)
    for program, main in (("dangers", "play"), ("served", "served")):
        dangers.link(objects, folder / program, main)


class DefectLink:
    """Link to a module of `firmware/dangers/served.cpp`, whose time passes only while bytes are waited for.

    Attributes
    ----------
    heard : list of Message
        All that the module has said.
    driven : bool
        Whether its driver has ever been on since the link was opened.
    hand_m_s : float
        Speed at which a hand pulls the cable's end.
    """

    lockstep = True
    file = None

    def __init__(self, program, defect, seed):
        words = [str(program), defect, str(seed), "stepped"]
        self._process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        port = int(self._process.stdout.readline())
        self.url = f"socket://127.0.0.1:{port}"
        self._socket = socket.create_connection(("127.0.0.1", port))
        self.heard, self.driven, self.hand_m_s = [], False, 0.0
        self._decoder, self._sent, self._came, self._us = Decoder(), 0, 0, 0

    def send(self, content):
        self._socket.sendall(content)
        self._sent += len(content)

    def receive(self, timeout):
        end = self._us + max(round(1e6 * timeout), 0)
        while True:
            content = self._pass(min(end - self._us, STEP_US))
            if content or self._us >= end:
                return content

    def _pass(self, us):
        self._process.stdin.write(struct.pack("=IIf", us, self._sent, self.hand_m_s))
        self._process.stdin.flush()
        passed, total, driven = struct.unpack("=IIB", self._process.stdout.read(9))
        self._us += passed
        self.driven |= bool(driven)
        content = b""
        while len(content) < total - self._came:
            content += self._socket.recv(total - self._came - len(content))
        self._came = total
        self.heard += [read(frame) for frame in self._decoder.feed(content)]
        return content

    def clock(self):
        return 1e-6 * self._us

    def close(self):
        """Do nothing: the link can be opened again until `end`."""

    def end(self):
        self._socket.close()
        self._process.stdin.close()
        self._process.stdout.close()
        self._process.wait()

    @property
    def armed(self):
        """Whether the module has ever said that it was armed, or has acknowledged that."""
        kinds, driven = Acknowledge | Event | Info | Telemetry, {State.ARMED, State.RUNNING}
        return any(isinstance(each, kinds) and each.state in driven for each in self.heard)
