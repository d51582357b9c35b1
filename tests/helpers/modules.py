"""A host's side of the link to one simulated module, for the tests."""

from dataclasses import replace

from serial.tools.list_ports_common import ListPortInfo

from tensionlab.hardware.protocol.codes import PARAMETERS, Calibration, Code, State
from tensionlab.hardware.protocol.messages import (
    Acknowledge,
    Arm,
    Calibrate,
    Decoder,
    EmergencyStop,
    Hello,
    Info,
    Message,
    SetImpedance,
    SetParameter,
    SetTension,
    read,
)
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule

SESSION = 77


def serial_port(device, description="n/a", hwid="n/a", vid=None):
    """A serial port as the system describes it."""
    port = ListPortInfo(device, skip_link_detection=True)
    port.description, port.hwid, port.vid = description, hwid, vid
    return port


class Host:
    """Says messages to a module and hears what comes back; time passes only where it says so."""

    def __init__(self, session=SESSION, **options):
        self.module = SimulatedModule(**options)
        self.decoder = Decoder()
        self.sequence, self.rounds = 0, 0
        self.session = session
        self.module.advance(STEP_S)  # before its first step, the firmware knows nothing

    def say(self, message: Message, sequence: int | None = None) -> list[Message]:
        """Send a message; what the module has said up to now, without any time passing."""
        if sequence is None:
            self.rounds += self.sequence == 255
            sequence = self.sequence = (self.sequence + 1) % 256
        if isinstance(message, Arm):
            self.rounds = 0
        if isinstance(message, SetTension | SetImpedance) and not message.rounds:
            message = replace(message, rounds=self.rounds)
        self.module.receive(message.frame(sequence).pack())
        return self.hear()

    def hear(self) -> list[Message]:
        return [read(frame) for frame in self.decoder.feed(self.module.transmit())]

    def code(self, message: Message, sequence: int | None = None) -> Code:
        """What a message is acknowledged with; nothing else may come back."""
        self.hear()
        (answer,) = self.say(message, sequence)
        assert isinstance(answer, Acknowledge)
        assert answer.command == message.type
        assert answer.state == self.state
        return answer.code

    def set(self, **parameters: float) -> None:
        for name, value in parameters.items():
            assert self.code(SetParameter(PARAMETERS[name].index, value)) == Code.OK, name

    def calibrate(self, newton_per_ampere=3.0, length=None) -> None:
        assert self.code(Calibrate(Calibration.NEWTON_PER_AMPERE, newton_per_ampere)) == Code.OK
        if length is not None:
            assert self.code(Calibrate(Calibration.LENGTH, length)) == Code.OK

    def info(self) -> Info:
        """What the module says of itself; nothing else may come back."""
        self.hear()
        (info,) = self.say(Hello(), 0)
        assert isinstance(info, Info)
        return info

    def arm(self) -> None:
        assert self.code(Arm(self.session, self.info().stops)) == Code.OK

    def pull(self, tension: float, *, brake: bool = False, ttl_ms: int = 0) -> None:
        assert self.say(SetTension(self.session, tension, brake, ttl_ms)) == []

    def render(self, **numbers) -> None:
        nothing = {"rest": 0.0, "stiffness": 0.0, "damping": 0.0, "feed_forward": 0.0}
        assert self.say(SetImpedance(self.session, **(nothing | numbers))) == []

    def hold(self, tension: float, seconds: float, *, distance: float | None = None, brake: bool = False) -> list:
        """Repeat a set-point at 50 Hz; the traces of the whole time."""
        steps = round(seconds / 0.02)
        start = self.module.sample.distance
        end = start if distance is None else distance
        traces = []
        for step in range(1, steps + 1):
            self.pull(tension, brake=brake)
            traces.append(self.module.trace(0.02, start + (end - start) * step / steps))
            self.hear()
        return traces

    @property
    def state(self) -> State:
        return self.module.sample.state


def armed(newton_per_ampere=3.0, parameters=None, **options) -> Host:
    """A host whose module is armed, with these parameters, and knows the length of its cable."""
    host = Host(**options)
    host.set(**parameters or {})
    host.calibrate(newton_per_ampere, host.module.sample.distance)
    host.arm()
    return host


def host_in(state: State, **options) -> Host:
    """A host whose module is in this state, pulling with more than the minimum tension where it may."""
    if state == State.IDLE:
        host = Host(**options)
        host.calibrate(length=host.module.sample.distance)
        return host
    host = armed(**options)
    if state == State.ARMED:
        host.module.advance(0.02)
    else:
        host.hold(3.0, 0.1)
    if state == State.TIMEOUT:
        host.module.advance(0.3)
    elif state == State.FAULT:
        host.module.damage("encoder")
        host.module.advance(0.01)
        host.module.damage("encoder", broken=False)
        host.module.advance(0.02)
    elif state == State.ESTOP:
        host.say(EmergencyStop())
    host.hear()
    assert host.state == state
    return host
