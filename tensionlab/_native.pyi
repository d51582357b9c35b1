"""Compiled kernels: arrays in, arrays out (`native/bindings/module.cpp`)."""

from collections.abc import Callable
from typing import TypeVar

from numpy import bool_, float64, int8, int64
from numpy.typing import NDArray

_Result = TypeVar("_Result")

MAX_COMPONENTS: int
MAX_CABLES: int
GRAZING: float
COMPILER: str
INSTRUCTION_SETS: tuple[str, ...]
INSTRUCTION_SET: str

# Structure, wrench, lower, upper, reference and weights of a batch of problems.
_Arrays = tuple[
    NDArray[float64], NDArray[float64], NDArray[float64], NDArray[float64], NDArray[float64], NDArray[float64]
]
# Structure, weighted directions, force, desired matrices (2, d, d), ranges (6, m) and the weight of a tie.
_Field = tuple[NDArray[float64], NDArray[float64], NDArray[float64], NDArray[float64], float, float]
# Tensions, scale and status.
_Solved = tuple[NDArray[float64], NDArray[float64], NDArray[int8]]

class TensionSolver:
    """Solver with its hyper-parameters. A rule is 0 without a policy, else 1 and the number of the policy."""

    def choose(
        self, problem: _Arrays, rule: int
    ) -> tuple[NDArray[float64], NDArray[int64], NDArray[float64] | None, dict[int, str]]: ...
    def allocate(
        self, problem: _Arrays, rule: int, largest: float, tolerance: float, rank_tolerance: float
    ) -> (
        tuple[
            NDArray[float64],
            NDArray[float64],
            NDArray[float64],
            NDArray[int8],
            NDArray[float64],
            NDArray[int64],
            NDArray[float64],
            dict[int, str],
        ]
        | None
    ): ...

def newton(rank_tolerance: float, tolerance: float) -> TensionSolver: ...
def dykstra(tolerance: float, iteration_limit: int, rank_tolerance: float) -> TensionSolver: ...
def log_barrier() -> TensionSolver: ...
def slack_norm(p: float, c1: float, c2: float, kappa: float, epsilon: float, gamma: float) -> TensionSolver: ...
def box_price(mu: float, force: float, torque: float) -> TensionSolver: ...
def closed_form(middle: bool, improved: bool, rank_tolerance: float) -> TensionSolver: ...
def puncture(rank_tolerance: float) -> TensionSolver: ...
def polygon(goal: int, rank_tolerance: float) -> TensionSolver: ...
def linear_program(program: int, alpha: float, rank_tolerance: float, tolerance: float) -> TensionSolver: ...
def prepare_call(
    solver: TensionSolver,
    lower: NDArray[float64],
    upper: NDArray[float64],
    reference: NDArray[float64],
    weights: NDArray[float64],
    rule: int,
    largest: float,
    tolerance: float,
    rank_tolerance: float,
    result: type[_Result],
) -> Callable[[object, object], _Result | None]: ...
def unprepared_call(
    solver: TensionSolver,
    rules: dict[str | None, int],
    refuses: Callable[[int, int], str | None] | None,
    largest: float,
    tolerance: float,
    rank_tolerance: float,
    result: type[_Result],
) -> Callable[[object, object, object, object, object], _Result | None]: ...
def allocation_jacobian(
    problem: _Arrays, solved: _Solved, policy: int, rank_tolerance: float, by_structure: bool
) -> tuple[NDArray[float64], NDArray[float64] | None, NDArray[bool_]]: ...
def allocation_gradients(
    problem: _Arrays, solved: _Solved, policy: int, rank_tolerance: float, cotangent: NDArray[float64]
) -> tuple[NDArray[float64], NDArray[float64], NDArray[float64], NDArray[float64], NDArray[float64]]: ...
def tighten(
    problem: _Arrays, program: int, alpha: float, costs: NDArray[float64]
) -> tuple[NDArray[float64], NDArray[float64], NDArray[int64], NDArray[float64]]: ...
def structure_matrices(
    anchors: NDArray[float64],
    attachments: NDArray[float64] | None,
    position: NDArray[float64],
    rotation: NDArray[float64] | None,
    radii: NDArray[float64] | None,
    axes: NDArray[float64] | None,
    least_share: float,
) -> tuple[NDArray[float64], NDArray[bool_]]: ...
def capacity_margin(
    structure: NDArray[float64],
    lower: NDArray[float64],
    upper: NDArray[float64],
    wrenches: NDArray[float64],
    rank_tolerance: float,
) -> NDArray[float64]: ...
def tension_factor(
    structure: NDArray[float64],
    lower: NDArray[float64],
    upper: NDArray[float64],
    rank_tolerance: float,
) -> NDArray[float64]: ...
def isotropic_force(
    structure: NDArray[float64],
    lower: NDArray[float64],
    upper: NDArray[float64],
    dimension: int,
    rank_tolerance: float,
) -> NDArray[float64]: ...
def feasible_direction_fraction(
    structure: NDArray[float64],
    lower: NDArray[float64],
    upper: NDArray[float64],
    wrenches: NDArray[float64],
    tolerance: float,
    rank_tolerance: float,
) -> NDArray[float64]: ...
def active_facet(
    structure: NDArray[float64],
    lower: NDArray[float64],
    upper: NDArray[float64],
    wrenches: NDArray[float64],
    rank_tolerance: float,
) -> tuple[NDArray[float64], NDArray[float64], NDArray[int64], NDArray[float64]]: ...
def half_spaces(
    structure: NDArray[float64],
    lower: NDArray[float64],
    upper: NDArray[float64],
    capacity: int,
    rank_tolerance: float,
) -> tuple[NDArray[float64], NDArray[float64], NDArray[float64]]: ...
def path(
    basis: NDArray[float64], space: NDArray[float64], reach: NDArray[float64], relaxation: float
) -> tuple[NDArray[float64], NDArray[float64], NDArray[float64], NDArray[float64], int]: ...
def verify(
    problem: _Arrays,
    tensions: NDArray[float64],
    separation: NDArray[float64],
    rule: int,
    tolerance: float,
    rank_tolerance: float,
) -> tuple[NDArray[float64], NDArray[float64], NDArray[int8], NDArray[float64], bool]: ...
def all_within(numbers: NDArray[float64], limit: float) -> bool: ...
def allocate_field(
    problem: _Field,
) -> tuple[NDArray[float64], NDArray[float64], NDArray[float64], NDArray[float64], NDArray[float64], float]: ...
def field_gap(
    problem: _Field,
    stiffness: NDArray[float64],
    damping: NDArray[float64],
    tensions: NDArray[float64],
    multipliers: NDArray[float64],
) -> float: ...
def predict_stiffness(
    matrix: NDArray[float64], axis: NDArray[float64], desired: float, host: float
) -> tuple[float, float, float, float, float]: ...
def stable_share(matrix: NDArray[float64], axis: NDArray[float64], mass: float, lag: float) -> float: ...
def module_springs(
    axis: NDArray[float64],
    part: tuple[float, float, float, float, float, float, float],
    velocity: NDArray[float64],
    lengths: NDArray[float64],
    directions: NDArray[float64],
    available: NDArray[bool_],
    free: NDArray[bool_],
    gains: NDArray[float64],
    limits: tuple[float, float, float, float, float, float],
    rule: tuple[float, ...],
    host_stiffness: float,
    previous_share: float,
    step: float,
) -> (
    tuple[list[tuple[int, float, float, float, float, float, float]], NDArray[float64], float, float, float] | None
): ...
def choose_locks(
    structure: NDArray[float64],
    normal: NDArray[float64],
    force: NDArray[float64],
    pushing: NDArray[bool_],
    held: NDArray[bool_],
    stiffness_ratio: NDArray[float64],
    limits: NDArray[float64],
    brake: NDArray[bool_],
    margin: float,
    most: int,
    price: float,
    hysteresis: float,
    negligible: float,
    rank_tolerance: float,
) -> tuple[NDArray[bool_], NDArray[float64], NDArray[float64], NDArray[bool_]]: ...
def certify_cells(
    anchors: NDArray[float64],
    arms: NDArray[float64],
    lower: NDArray[float64],
    upper: NDArray[float64],
    required: NDArray[float64],
    radius: float,
    slack: float,
    angle: float,
    length: float,
    closure: bool,
    radii: NDArray[float64] | None,
    axes: NDArray[float64] | None,
    weight: bool,
    centres: NDArray[float64],
    half_edges: NDArray[float64],
    with_shares: bool,
) -> tuple[NDArray[int8], NDArray[float64] | None]: ...
def pulley_bends(
    vectors: NDArray[float64], radii: NDArray[float64], axes: NDArray[float64], moved: NDArray[float64]
) -> NDArray[float64]: ...
def segment_distances(
    segments: NDArray[float64],
    pairs: NDArray[int64],
    axes: NDArray[float64] | None,
    halves: NDArray[float64] | None,
) -> NDArray[float64]: ...

class Watchdog:
    def __init__(self, message: str) -> None: ...
    def kick(self, seconds: float) -> None: ...
    def close(self) -> None: ...

class PoseTracker:
    def __init__(
        self,
        anchors: NDArray[float64],
        attachments: NDArray[float64],
        position: NDArray[float64],
        radii: NDArray[float64],
        axes: NDArray[float64],
    ) -> None: ...
    def follow(
        self, lengths: NDArray[float64], known: NDArray[bool_], steps: int, tolerance: float
    ) -> tuple[NDArray[float64], NDArray[float64], NDArray[float64], float, int, float]: ...
    def velocity(self, speeds: NDArray[float64], known: NDArray[bool_]) -> NDArray[float64]: ...

class LengthCheck:
    def __init__(self, cables: int) -> None: ...
    def update(
        self,
        tracker: PoseTracker,
        lengths: NDArray[float64],
        speeds: NDArray[float64],
        tensions: NDArray[float64],
        known: NDArray[bool_],
        seconds: float,
    ) -> tuple[float, float]: ...
    def protection(self, tracker: PoseTracker, tensions: NDArray[float64]) -> float: ...
    def doubts(self) -> tuple[NDArray[float64], ...]: ...

def synchronise(
    lengths: NDArray[float64], speeds: NDArray[float64], ages: NDArray[float64], max_age: float
) -> NDArray[float64]: ...
def any_exceeds(numbers: NDArray[float64], thresholds: NDArray[float64]) -> bool: ...
def next_tensions(
    before: NDArray[float64],
    chosen: NDArray[float64],
    free: NDArray[bool_],
    lower: NDArray[float64],
    upper: NDArray[float64],
    max_change: float,
) -> tuple[NDArray[float64], NDArray[float64], bool, int]: ...
def seconds_now() -> float: ...

MAX_LENGTH_JUMP_M: float
MAX_ACCELERATION_M_S2: float

class FrameDecoder:
    bad_frames: int
    kept: int
    def feed(self, content: bytes) -> list[tuple[int, int, bytes]]: ...

class Endpoint:
    def __init__(self, set_point: int) -> None: ...
    stale: int
    repeated: int
    bad_frames: int
    kept: int
    followed: bool
    state: int
    faults: int
    session: int
    python_decodes: bool
    needs_attention: bool
    def feed(self, content: bytes, now: float) -> bool: ...
    def take_queue(self) -> list[tuple[int, int, bytes]]: ...
    def take(self, payload: bytes, now: float) -> bool: ...
    def next_set_point(self) -> int: ...
    def next_arm(self) -> int: ...
    def latest(self, seen: int) -> tuple[int, bytes, float] | None: ...
    def unchecked(self) -> tuple[tuple[bytes, float] | None, tuple[bytes, float]] | None: ...
    def clear_checked(self) -> None: ...
    def set_file(self, file: int) -> None: ...

class EndpointGroup:
    def __init__(self, endpoints: list[Endpoint]) -> None: ...
    def observe(
        self, clocks: list[float], idle_state: int, idle_limit: int
    ) -> tuple[NDArray[float64], NDArray[int64]]: ...
    def suspects(
        self, clocks: list[float], active: NDArray[bool_], delays: NDArray[float64], ttl: float
    ) -> list[int]: ...
    def send(
        self, tensions: NDArray[float64], chosen: NDArray[bool_], brakes: NDArray[bool_], ttl_ms: int
    ) -> tuple[NDArray[int64], list[int], list[tuple[int, int]]]: ...

class LinkReader:
    def add(self, file: int, endpoint: Endpoint | None) -> None: ...
    def drop(self, file: int) -> None: ...
    def wait(self) -> list[int]: ...

class SetPointDelays:
    def __init__(self, modules: int, kept: int) -> None: ...
    def send(self, sequences: NDArray[int64], now: float) -> None: ...
    def delays(self, last_sequence: NDArray[int64], now: float) -> tuple[NDArray[float64], NDArray[float64]]: ...

MAX_PAYLOAD: int
MAX_PIECE: int

def parse_frames(stream: bytes) -> tuple[list[tuple[int, int, bytes]], int]: ...
def build_frame(kind: int, sequence: int, payload: bytes) -> bytes: ...
def parameter_table() -> list[tuple[str, str, float, float, float]]: ...
def plant_table() -> list[tuple[str, str, float, float, str]]: ...
def plant_parts() -> list[str]: ...
def step_microseconds() -> int: ...
def transition_table() -> list[list[tuple[bool, int]]]: ...

class SimulatedModule:
    def __init__(
        self,
        serial_number: int,
        plant: dict[str, float],
        distance: float,
        seed: int,
        start_us: int,
        reset_reason: int,
    ) -> None: ...
    def load(self, image: bytes) -> bool: ...
    def stored(self) -> bytes: ...
    def receive(self, stream: bytes, ahead_us: int) -> None: ...
    def overhear(self, stream: bytes) -> None: ...
    def transmit(self) -> bytes: ...
    def close_link(self) -> None: ...
    def advance(self, steps: int, distance: float) -> None: ...
    def trace(self, steps: int, distance: float) -> NDArray[float64]: ...
    def sample(
        self,
    ) -> tuple[float, float, float, float, float, float, float, float, float, int, int, bool, bool]: ...
    def faults(self) -> int: ...
    def parameters(self) -> list[float]: ...
    def pause(self, microseconds: int) -> None: ...
    def set_broken(self, what: str, broken: bool) -> None: ...
