"""The kernel of a mechanism: its arrays, and entries that fill them (compiled).

Joints are taken apart into what S has one block for: at most ``WIDTH`` rows, point rows with none or two axis rows, or
line, axis or moving rows alone. They are sorted by kind, so that each kind is one loop; ``order`` leads back.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ....harness.mechanics import joints
from ....harness.mechanics.state import State
from ....harness.mechanics.system import GROUND, MultibodySystem
from ....harness.mechanics.user_forces import NUMBERS as NUMBERS_READ
from ..generated import compile_functions
from ..rows.expressions import force_numbers, joint_numbers
from ..rows.loops import body_loop, push_loop, row_loop
from . import evaluation, factor, user_forces
from .blocks import WIDTH, Blocks, analyse
from .entries import Bound, Program, words_of

STATE = np.dtype([("shift", "f8"), ("rank", "i8")])


class Users(NamedTuple):
    """User forces."""

    body: Any  # (nu, 2)
    law: Any  # (nu,) addresses
    state: Any  # (36,) what they read
    load: Any  # (4, 3) and write


class Kernel(NamedTuple):
    """Arrays of one mechanism at one state, and the words of its entries. Rows are in the kernel's order."""

    mass: Any  # (nb,)
    J: Any  # (nb, 3, 3)
    J_inv: Any  # (nb, 3, 3) with all inertia that is lent
    coupled: Any  # (nb, 3, 3) what is to be taken back of it; (0, 3, 3) where nothing is
    body: Any  # (nj, 2) ends of each joint, -1: the ground
    row: Any  # (nj + 1,) first row of each joint
    pins: Any  # (nj,) 1: the first three rows are point rows, the others have no force
    blocks: Blocks
    users: Users
    state: Any  # record: shift of S's diagonal (relative), rank found
    t: Any  # (1,) [s], to be set before rows and forces are evaluated
    r: Any  # (nb, 3)
    R: Any  # (nb, 3, 3)
    v: Any  # (nb, 6)
    v_dot: Any  # (nb, 6)
    force: Any  # (nb, 6): applied force [space], torque about C [body]
    X: Any  # (2, nrows, 3): torque of each row on either end, in the body, with its sign
    Y: Any  # (2, nrows, 3): X J^-1
    way: Any  # (nrows, 3): force of each row on end i, in space; the opposite on j
    phi: Any  # (nrows,)
    slip: Any  # (nrows,) phi_t: phi_dot = A v + phi_t
    gamma: Any  # (nrows,) A_dot v + (phi_t)_dot
    lam: Any  # (nrows,) reaction conjugate to phi
    rhs: Any  # (nrows,) right-hand side and solution of S
    L: Any  # (nblocks, WIDTH, WIDTH): S, then its factor; diagonal entries inverted, 0 for a redundant row
    diagonal: Any  # (nrows,) of S, what its pivots are compared with
    change: Any  # (nb, 6)
    spun: Any  # (nb, 3)
    left: Any  # (nb, 3)
    toward: Any  # (nb, 3)
    x: Any  # (nrows,) of ``push``, ``push_kept``: multipliers; of ``slips`` its result
    w: Any  # (nb, 6) of ``push``, ``push_kept``, ``slips``, ``divide``: velocities
    Y0: Any  # Y and way that ``keep_rows`` has kept
    way0: Any
    order: Any  # (nrows,) place of each row of the system in the kernel
    rows: int = 0  # X, Y, way, phi, slip, gamma at (t, r, R, v)
    factorise: int = 0  # S of these rows, and its factor
    solve: int = 0  # rhs := S^-1 rhs
    forces: int = 0  # force, less Omega x J Omega
    applied: int = 0  # force alone
    react: int = 0  # v_dot and lam with rows and factor at hand
    accelerate: int = 0  # rows, factorise, react
    reactions: int = 0  # rows, react
    project: int = 0  # poses and velocities onto the constraints
    project_rates: int = 0  # velocities alone, with rows and factor at hand
    divide: int = 0  # w := M^-1 w
    push: int = 0  # w += M^-1 A^T x
    push_kept: int = 0  # with the rows kept
    keep_rows: int = 0
    slips: int = 0  # x := -(A w + phi_t)
    take_back: int = 0  # of ``react``: lent inertia


class Part(NamedTuple):
    """What has one block of S: rows lo to hi of a joint."""

    kind: int
    lo: int
    hi: int
    ground: bool
    joint: int


class Made(NamedTuple):
    """A kernel, and what keeps its entries alive."""

    kernel: Kernel
    keeps: list[Any]

    def entry(self, name: str) -> Callable[[], None]:
        """An entry, to be called from Python."""
        return partial(Program.run, getattr(self.kernel, name))


def make_kernel(system: MultibodySystem) -> Made:
    """The kernel by loops over joints of one kind, for mechanisms of any size."""
    k, parts = _room(system)
    keeps: list[Any] = []
    entries = {"rows": _rows(system, k, parts, keeps)}
    for name, gyroscopic in (("forces", True), ("applied", False)):
        entries[name] = _forces(system, k, keeps, gyroscopic=gyroscopic)
    points = "_points" if k.L.shape[1] == 3 else ""
    bound = {name: getattr(factor, name + points) for name in ("factorise", "solve")}
    bound |= {name: getattr(evaluation, name) for name in EVALUATION if name != "take_back" or len(k.coupled)}
    # words of a kernel have one length, so that entries may hold the address of the array that is filled last
    words = np.array(words_of(k), dtype=np.int64)
    for name, function in bound.items():
        one = Bound(function, k, words)
        keeps.append(one)
        entries[name] = one.entry
    k = Kernel(**{**k._asdict(), **entries})
    words[:] = words_of(k)
    return Made(k, [words, *keeps])


EVALUATION = (
    "react", "accelerate", "reactions", "project", "project_rates", "take_back", "divide", "push", "push_kept",
    "keep_rows", "slips",
)  # fmt: skip


def start_at(k: Kernel, state: State) -> None:
    """Put the mechanism where ``state`` has it."""
    k.r[:], k.R[:], k.v[:, :3], k.v[:, 3:], k.t[0] = state.r, state.R, state.v, state.Omega, state.t


def _room(system: MultibodySystem) -> tuple[Kernel, list[Part]]:
    found = list(_parts(system))
    place = _sorted(found)
    parts = parts_of(system)
    size = np.array([part.hi - part.lo for part in parts], dtype=np.int64)
    row = np.concatenate(([0], np.cumsum(size))).astype(np.int64)
    joint = np.array([part.joint for part in parts], dtype=np.int64)
    body = np.stack((system.joint_i, system.joint_j), axis=1).astype(np.int64)[joint].reshape(-1, 2)
    nb, nr = system.nb, int(row[-1])
    order = np.zeros(nr, dtype=np.int64)
    for p, part in enumerate(parts):
        first = int(system.row_start[part.joint])
        order[first + part.lo : first + part.hi] = row[p] + np.arange(part.hi - part.lo)
    counts = [joints.DECLARED[joints.KINDS[part.kind]].count for part in parts]
    pins = np.array([c.point == 3 and part.lo == 0 for c, part in zip(counts, parts, strict=True)], dtype=np.int64)
    users = np.stack((system.user_i, system.user_j), axis=1).astype(np.int64)

    def bodies(*shape: int) -> np.ndarray:  # with one more, the ground, behind
        return np.zeros((nb + 1, *shape))[:nb]

    taken_back, blocks = system.taken_back, _blocks(body, row, place)
    width = 3 if np.max(size, initial=0) <= 3 else WIDTH
    return Kernel(
        mass=np.array(system.mass), J=np.array(system.solved_inertia), J_inv=_filled(bodies(3, 3), _inverse(system)),
        coupled=np.array(taken_back) if np.any(taken_back) else np.zeros((0, 3, 3)),
        body=body, row=row, pins=pins, blocks=blocks, state=np.zeros((), dtype=STATE),
        users=Users(users, np.array([law.entry.address for law in system.user_law], dtype=np.int64),
                    np.zeros(NUMBERS_READ), np.zeros((4, 3))),
        t=np.zeros(1), r=bodies(3), R=bodies(3, 3), v=bodies(6), v_dot=bodies(6), force=bodies(6),
        X=np.zeros((2, nr, 3)), Y=np.zeros((2, nr, 3)), way=np.zeros((nr, 3)), phi=np.zeros(nr), slip=np.zeros(nr),
        gamma=np.zeros(nr), lam=np.zeros(nr), rhs=np.zeros(nr), diagonal=np.zeros(nr),
        L=np.zeros((len(blocks.other), width, width)),
        change=bodies(6), spun=bodies(3), left=bodies(3), toward=bodies(3),
        x=np.zeros(nr), w=bodies(6), Y0=np.zeros((2, nr, 3)), way0=np.zeros((nr, 3)), order=order,
    ), parts  # fmt: skip


def parts_of(system: MultibodySystem) -> list[Part]:
    """In the kernel's order: by kind."""
    found = list(_parts(system))
    return [found[p] for p in _sorted(found)]


def _sorted(parts: list[Part]) -> list[int]:
    return sorted(range(len(parts)), key=lambda p: (parts[p][:4], p))


def _filled(room: np.ndarray, values: np.ndarray) -> np.ndarray:
    room[:] = values
    return room


def _inverse(system: MultibodySystem) -> np.ndarray:
    return np.linalg.inv(system.regular_inertia) if system.nb else np.zeros((0, 3, 3))


def _parts(system: MultibodySystem) -> Iterator[Part]:
    for j, sort in enumerate(system.joint_sort):
        c, ground = joints.DECLARED[joints.KINDS[sort]].count, bool(system.joint_j[j] == GROUND)
        ahead = c.point + c.line + c.moving
        if c.point and c.axis in (0, 2):
            yield Part(int(sort), 0, ahead + c.axis, ground, j)
            continue
        if ahead:
            yield Part(int(sort), 0, ahead, ground, j)
        if c.axis:
            yield Part(int(sort), ahead, ahead + c.axis, ground, j)


def _blocks(body: np.ndarray, row: np.ndarray, place: list[int]) -> Blocks:
    """Analysed in the system's order of joints, on which the choice among redundant rows depends."""
    back = np.argsort(place) if place else np.zeros(0, dtype=np.int64)
    size = np.diff(row)[back]
    first = np.concatenate(([0], np.cumsum(size))).astype(np.int64)
    found = analyse(body[back], first)
    joint = back[found.joint] if len(place) else found.joint
    return found._replace(joint=joint.astype(np.int64), row=row[:-1][joint].astype(np.int64))


def _rows(system: MultibodySystem, k: Kernel, parts: list[Part], keeps: list[Any]) -> int:
    steps: list[tuple[int, list[np.ndarray]]] = []
    at = 0
    while at < len(parts):
        key = parts[at][:4]
        end = at
        while end < len(parts) and parts[end][:4] == key:
            end += 1
        kind, lo, hi, ground = key
        name = joints.KINDS[kind]
        made = row_loop(str(name), tuple(range(lo, hi)), bool(ground))
        code = compile_functions({"rows": made.loop})
        rows = slice(int(k.row[at]), int(k.row[end]))
        if made.way is not None:
            k.way[rows] = np.tile(np.array(made.way), (end - at, 1))
        numbers = joint_numbers(system, np.array([part.joint for part in parts[at:end]]))
        ends = [0] if ground else [0, 1]
        stored = [k.phi[rows], k.gamma[rows], *(k.X[e, rows] for e in ends), *(k.Y[e, rows] for e in ends)]
        stored += [] if made.way is not None else [k.way[rows]]
        stored += [] if made.still else [k.slip[rows]]
        blocks = [pair for e in ends for pair in _places(k.body[at:end, e], (k.r, 3), (k.R, 9), (k.v, 6), (k.J_inv, 9))]
        arrays = [np.array([end - at]), k.t, numbers, *[a for pair in blocks for a in pair], *stored]
        steps.append((code.address("rows"), arrays))
        keeps.append(code)
        at = end
    program = Program(steps, keeps=k)
    keeps.append(program)
    return program.entry


def _places(body: np.ndarray, *arrays: tuple[np.ndarray, int]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Arrays of bodies with the first places of those asked for."""
    for array, size in arrays:
        yield array, np.ascontiguousarray(body * size)


def _forces(system: MultibodySystem, k: Kernel, keeps: list[Any], *, gyroscopic: bool) -> int:
    code = compile_functions({"bodies": body_loop(gyroscopic=gyroscopic)})
    weight = system.mass[:, None] * system.gravity
    steps: list[tuple[int, Sequence[np.ndarray]]] = [
        (code.address("bodies"), [np.array([system.nb]), weight, k.J, k.v, k.force])
    ]
    keeps.append(code)
    for kind in ("spring", "torsion", "load"):
        i = np.asarray(getattr(system, f"{kind}_i"))
        j = np.full(len(i), GROUND) if kind == "load" else np.asarray(getattr(system, f"{kind}_j"))
        for ground in (False, True):
            own = np.flatnonzero((j == GROUND) == ground)
            if not len(own):
                continue
            made = compile_functions({"push": push_loop(kind, ground)})
            both = (i[own],) if ground else (i[own], j[own])
            blocks = [a for b in both for pair in _places(b, (k.r, 3), (k.R, 9), (k.v, 6)) for a in pair]
            added = [a for b in both for pair in _places(b, (k.force, 6)) for a in pair]
            numbers = force_numbers(system, kind)[own]
            steps.append((made.address("push"), [np.array([len(own)]), k.t, numbers, *blocks, *added]))
            keeps.append(made)
    if len(k.users.law):
        users = Bound(user_forces.add_user_forces, k)
        keeps.append(users)
        steps += users.program.steps
    program = Program(steps, keeps=k)
    keeps.append(program)
    return program.entry
