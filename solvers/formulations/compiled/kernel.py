"""The kernel of a mechanism: its arrays, and entries that fill them (compiled).

Joints are split into parts for which S has one block: at most ``WIDTH`` rows, point rows with none or two axis rows, or
line, axis or moving rows alone. Parts are sorted by kind, so that each kind is one loop; ``order`` gives the position
of each row of the system.
"""

import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from ....harness.base.generated import Code, Program
from ....harness.mechanics import joints
from ....harness.mechanics.fixed_order import inverse
from ....harness.mechanics.state import State
from ....harness.mechanics.system import GROUND, MultibodySystem
from ....harness.mechanics.user_forces import NUMBERS as NUMBERS_READ
from ..rows.kept_code import load_or_make_code, load_row_code
from ..rows.numbers import list_force_parameters, list_joint_parameters
from . import evaluation, factor, row_choice, user_forces
from .blocks import WIDTH, Blocks, analyse_joint_blocks
from .entries import PYTHON, BoundFunction, digest_callees
from .python_code import PythonLoop

ROWS = f"{__package__.rsplit('.', 1)[0]}.rows"  # package of the expressions that loops are made of
STATE = np.dtype([("shift", "f8"), ("rank", "i8"), ("first", "i8"), ("limit", "f8"), ("chosen", "i8"), ("poor", "f8")])
UNKNOWN = -1, row_choice.POOR, 0, row_choice.POOR


class UserForces(NamedTuple):
    """The user forces of a system: their bodies, the addresses of their laws, and arrays for a call."""

    body: Any  # (nu, 2)
    law: Any  # (nu,) addresses
    state: Any  # (36,) input of the laws
    load: Any  # (4, 3) output of the laws


class Kernel(NamedTuple):
    """The arrays of one mechanism at one state, and its entries, which are programs. Rows are in the kernel's order."""

    mass: Any  # (nb,)
    J: Any  # (nb, 3, 3)
    J_inv: Any  # (nb, 3, 3)
    body: Any  # (nj, 2) ends of each joint, -1: the ground
    row: Any  # (nj + 1,) first row of each joint
    pins: Any  # (nj,) 1: the first three rows are point rows, the others have no force
    blocks: Blocks
    users: UserForces
    state: Any  # record: shift of S's diagonal (relative), rank found, and the state of ``row_choice``
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
    diagonal: Any  # (nrows,) diagonal of S, which its pivots are compared with
    dense: Any  # (nrows, nrows) S to choose rows from, empty where none can be redundant or they are too many
    chosen: Any  # (nrows,) 1: rows of that choice
    pivot_bound: Any  # (nrows,) for code of the mechanism: share of its diagonal below which a row's pivot is left out
    inverse_share: Any  # (nrows,) from such code: each row's diagonal over its pivot, 0 for a row left out
    turn: Any  # (nj, 3, 3) by blocks: directions in which S has the point rows of hinges, 0 0 0 for those of space
    change: Any  # (nb, 6)
    x: Any  # (nrows,) multipliers for ``push``, ``push_kept``; result of ``slips``
    w: Any  # (nb, 6) velocities for ``push``, ``push_kept``, ``slips``, ``divide``
    Y0: Any  # Y and way that ``keep_rows`` has kept
    way0: Any
    order: Any  # (nrows,) place of each row of the system in the kernel
    pair: Any  # (npairs, 2) for each block of slopes: the loaded body, the moving body; first (b, b) for each b
    by_pose: Any  # (npairs, 6, 6) slopes by dr [space] and dtheta, R exp(hat(dtheta))
    by_rate: Any  # (npairs, 6, 6) slopes by velocities
    rate_slope: Any  # (2, nrows, 6) d(phi_dot)/d(pose) of either end
    rows: Any = 0  # X, Y, way, phi, slip, gamma at (t, r, R, v)
    factorise: Any = 0  # S of these rows, and its factor
    solve: Any = 0  # rhs := S^-1 rhs
    leave_out: Any = 0  # rhs := 0 in rows left out, once rows were chosen anew
    forces: Any = 0  # force, less Omega x J Omega
    applied_forces: Any = 0  # force alone
    react: Any = 0  # v_dot and lam with rows and factor at hand
    accelerate: Any = 0  # rows, factorise, react
    reactions: Any = 0  # rows, react
    close_joints: Any = 0  # poses onto phi = 0, with rows and factor at hand
    project: Any = 0  # close_joints, rows, project_rates
    project_rates: Any = 0  # velocities alone, with rows and factor at hand
    divide: Any = 0  # w := M^-1 w
    push: Any = 0  # w += M^-1 A^T x
    push_kept: Any = 0  # with the rows kept
    keep_rows: Any = 0
    slips: Any = 0  # x := -(A w + phi_t)
    force_slopes: Any = 0  # by_pose, by_rate := slopes of ``forces``
    applied_slopes: Any = 0  # the same of ``applied_forces``
    spring_slopes: Any = 0  # the same for spring-dampers alone
    load_slopes: Any = 0  # by_pose += slopes of A^T lam, with ``lam`` as it is
    rate_slopes: Any = 0  # rate_slope
    factorise_code: Any = 0  # the factor by code of the mechanism, with ``pivot_bound``
    fill_dense: Any = 0  # dense := S of the rows at hand, by code of the mechanism


OF_CODE = ("factorise_code", "fill_dense")  # what only code of a mechanism has
ENTRIES = tuple(name for name in Kernel._field_defaults if name not in OF_CODE)


class Part(NamedTuple):
    """Rows lo to hi (excluded) of a joint, which have one block of S."""

    kind: int
    lo: int
    hi: int
    ground: bool
    joint: int


def make_kernel(system: MultibodySystem, needed: Collection[str] = ENTRIES) -> Kernel:
    """Make the kernel of a system: its arrays, and programs for the entries that are ``needed``, by default all."""
    return finish_kernel(system, allocate_kernel(system), needed)


def finish_kernel(system: MultibodySystem, k: Kernel, needed: Collection[str]) -> Kernel:
    """Return the kernel with programs for the entries that are ``needed``, and for those that these call."""
    loops = Loops(system, k)
    made: dict[str, Program] = {}

    def get_program(name: str) -> Program:
        """Return the program of the entry ``name``, made at the first call."""
        if name not in made:
            made[name] = make_program(name)
        return made[name]

    def make_program(name: str) -> Program:
        """Make the program of the entry ``name``: loops by kind, other entries in turn, or one compiled function."""
        if hasattr(loops, name):
            return Program(getattr(loops, name)(), loops, f"kernel.{name}")
        if name in JOINED:
            parts = [get_program(part) for part in JOINED[name]]
            return Program([step for part in parts for step in part.steps], parts, f"kernel.{name}")
        if name == "leave_out":
            return BoundFunction(row_choice.leave_out, k) if len(k.dense) else Program([])
        points = "_points" if k.L.shape[1] == 3 else ""
        function = getattr(factor, name + points) if name in FACTOR else getattr(evaluation, name)
        found = BoundFunction(function, with_entries(digest_callees(function).names))
        if name == "factorise" and len(k.dense):
            choose = BoundFunction(getattr(row_choice, f"choose_rows{points}"), k)
            return Program([*found.steps, *choose.steps], (found, choose), "kernel.factorise")
        return found

    def with_entries(names: Collection[str]) -> Kernel:
        """Return the kernel with programs for those of its entries that are among ``names``."""
        found: dict[str, Any] = {x: get_program(x) for x in ENTRIES if x in names}
        return k._replace(**found)

    return with_entries(needed)


FACTOR = ("factorise", "solve")
JOINED = {
    "accelerate": ("rows", "factorise", "react"),
    "reactions": ("rows", "react"),
    "project": ("close_joints", "rows", "project_rates"),
}


def set_state(k: Kernel, state: State) -> None:
    """Set poses, velocities and time of the kernel to those of ``state``, and discard an earlier choice of rows."""
    k.r[:], k.R[:], k.v[:, :3], k.v[:, 3:], k.t[0] = state.r, state.R, state.v, state.Omega, state.t
    forget_choice(k)  # of an earlier run


def forget_choice(k: Kernel) -> None:
    """Restart the choice among redundant rows (module ``row_choice``), as if nothing had been factorised yet."""
    for name, value in zip(("first", "limit", "chosen", "poor"), UNKNOWN, strict=True):
        k.state[name] = value


def allocate_kernel(system: MultibodySystem) -> Kernel:
    """Make the arrays of a system's kernel, with all entries unset (0)."""
    place, parts = list_parts(system)
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

    def bodies(*shape: int) -> np.ndarray:  # zeros for each body
        return np.zeros((nb, *shape))

    blocks = _analyse_blocks(body, row, place)
    pair = _list_body_pairs(system)
    width = 3 if np.max(size, initial=0) <= 3 else WIDTH
    return Kernel(
        mass=np.array(system.mass),
        J=np.array(system.regular_inertia),
        J_inv=inverse(system.regular_inertia),
        body=body,
        row=row,
        pins=pins,
        blocks=blocks,
        state=np.array((0.0, 0, *UNKNOWN), dtype=STATE),
        users=UserForces(
            users,
            np.array([law.entry.address for law in system.user_law], dtype=np.int64),
            np.zeros(NUMBERS_READ),
            np.zeros((4, 3)),
        ),
        t=np.zeros(1),
        r=bodies(3),
        R=bodies(3, 3),
        v=bodies(6),
        v_dot=bodies(6),
        force=bodies(6),
        X=np.zeros((2, nr, 3)),
        Y=np.zeros((2, nr, 3)),
        way=np.zeros((nr, 3)),
        phi=np.zeros(nr),
        slip=np.zeros(nr),
        gamma=np.zeros(nr),
        lam=np.zeros(nr),
        rhs=np.zeros(nr),
        diagonal=np.zeros(nr),
        L=np.zeros((len(blocks.other), width, width)),
        dense=np.zeros((nr, nr) if row_choice.may_choose(system) else (0, 0)),
        chosen=np.zeros(nr, dtype=np.int64),
        pivot_bound=np.full(nr, factor.DEPENDENT),
        inverse_share=np.zeros(nr),
        turn=np.zeros((len(parts), 3, 3)),
        change=bodies(6),
        x=np.zeros(nr),
        w=bodies(6),
        Y0=np.zeros((2, nr, 3)),
        way0=np.zeros((nr, 3)),
        order=order,
        pair=pair,
        by_pose=np.zeros((len(pair), 6, 6)),
        by_rate=np.zeros((len(pair), 6, 6)),
        rate_slope=np.zeros((2, nr, 6)),
    )


def list_parts(system: MultibodySystem) -> tuple[list[int], list[Part]]:
    """Return the parts in the kernel's order by kind, preceded by the index of each in the system's order."""
    found = list(_iterate_parts(system))
    place = sorted(range(len(found)), key=lambda p: (found[p][:4], p))
    return place, [found[p] for p in place]


def _iterate_parts(system: MultibodySystem) -> Iterator[Part]:
    """Yield the parts of all joints in the system's order.

    Raises ValueError for a joint with more rows in one part than a block of S has.
    """
    for j, sort in enumerate(system.joint_sort):
        c, ground = joints.DECLARED[joints.KINDS[sort]].count, bool(system.joint_j[j] == GROUND)
        ahead = c.point + c.line + c.moving  # rows before the axis rows
        if max(ahead, c.axis, ahead + c.axis if c.point and c.axis in (0, 2) else 0) > WIDTH:
            raise ValueError(f"{joints.KINDS[sort]} has more rows than the {WIDTH} of a block of S (got {sum(c)})")
        if c.point and c.axis in (0, 2):
            yield Part(int(sort), 0, ahead + c.axis, ground, j)
            continue
        if ahead:
            yield Part(int(sort), 0, ahead, ground, j)
        if c.axis:
            yield Part(int(sort), ahead, ahead + c.axis, ground, j)


def _analyse_blocks(body: np.ndarray, row: np.ndarray, place: list[int]) -> Blocks:
    """Return the pattern of S and of its factor, for parts in the kernel's order.

    ``body`` are the two bodies of each part, ``row`` its first constraint row, ``place`` its index in the system's
    order. The pattern is analysed in the system's order, on which the choice among redundant rows depends.
    """
    back = np.argsort(place) if place else np.zeros(0, dtype=np.int64)
    size = np.diff(row)[back]
    first = np.concatenate(([0], np.cumsum(size))).astype(np.int64)
    found = analyse_joint_blocks(body[back], first)
    joint = back[found.joint] if len(place) else found.joint
    return found._replace(joint=joint.astype(np.int64), row=row[:-1][joint].astype(np.int64))


def _list_body_pairs(system: MultibodySystem) -> np.ndarray:
    """Return the pairs of bodies (npairs, 2) that have slopes: the loaded body, then the moving one.

    First comes (b, b) for each body, then both orders for bodies coupled by a joint or force, each once.
    """
    ends = [(getattr(system, f"{name}_i"), getattr(system, f"{name}_j")) for name in ("joint", "spring", "torsion")]
    ends.append((system.user_i, system.user_j))
    both = {(int(a), int(b)) for one in ends for a, b in zip(*one, strict=True) if GROUND not in (a, b) and a != b}
    apart = sorted(both | {(b, a) for a, b in both})
    return np.array([*((b, b) for b in range(system.nb)), *apart], dtype=np.int64).reshape(-1, 2)


Step = tuple[int, Sequence[np.ndarray]]


class Loops:
    """The entries of a kernel that are loops over joints or forces of one kind, as steps of programs."""

    def __init__(self, system: MultibodySystem, k: Kernel) -> None:
        """Group the parts of joints by kind, and set ``k.way`` of those whose forces are constant."""
        self._system, self._k, self._parts = system, k, list_parts(system)[1]
        self._place = {(int(a), int(b)): n for n, (a, b) in enumerate(k.pair)}
        self._keeps: list[Any] = []
        self._groups = list(self._group_parts())
        for group in self._groups:
            way = load_row_code(*group.key).way
            if way is not None:
                k.way[group.rows] = np.tile(way, (len(group.body), 1))

    def bind(
        self,
        maker: str,
        signatures: Mapping[str, str],
        list_arrays: "Callable[[ElementGroup, Code], dict[str, list[Any]]]",
        *of: Any,
        **choices: Any,
    ) -> dict[str, Any]:
        """Return programs, by name, for functions that run over all joints, kind by kind.

        ``maker`` is "module.function" of folder ``rows``, which makes the functions of one kind; ``of`` and ``choices``
        are its further arguments. ``signatures`` has the names of the functions and, as their docstrings, what they
        read and write. ``list_arrays`` returns the arguments of each function for a group of joints with its code,
        after the number of joints. With ``MBSBENCH_PYTHON=1`` Python runs the functions.
        """
        calls: dict[str, list[Step]] = {name: [] for name in signatures}
        interpreted, (module, function) = os.environ.get(PYTHON) == "1", maker.split(".")
        for group in self._groups:
            code = load_or_make_code(maker, *group.key, *of, **choices)
            self._keeps.append(code)
            if interpreted:
                loops = getattr(import_module(f"{ROWS}.{module}"), function)(*group.key, *of, **choices)
            for name, arrays in list_arrays(group, code).items():
                call: Step = code.address(name), [group.members, *arrays]
                if interpreted:
                    self._keeps.append(PythonLoop(loops[name], call[1]))
                    call = self._keeps[-1].address, [np.zeros(1)]
                calls[name].append(call)
        made = dict[str, Any]()
        for name, steps in calls.items():
            made[name] = Program(steps, (self._keeps, self._k), f"{module}.{name}")
            made[name].__doc__ = signatures[name]
        return made

    def _make_loop_step(self, group: "ElementGroup", code: Code, name: str, *arrays: np.ndarray) -> Step:
        """Return the step that calls function ``name`` of ``code`` over a group's members; nothing is run here.

        Its arguments are the number of members, the time, their parameters, and ``arrays``.
        """
        self._keeps.append(code)
        return code.address(name), [group.members, self._k.t, group.numbers, *arrays]

    def rows(self) -> list[Step]:
        """Return the steps that compute the constraint rows: X, Y, way, phi, slip and gamma of the kernel.

        ``way`` of joints with constant forces and ``slip`` of those without a drive are not computed.
        """
        k, steps = self._k, []
        for group in self._groups:
            made, rows, ends = load_row_code(*group.key), group.rows, group.ends
            stored = [k.phi[rows], k.gamma[rows], *(k.X[e, rows] for e in ends), *(k.Y[e, rows] for e in ends)]
            stored += [] if made.way is not None else [k.way[rows]]
            stored += [] if made.is_phi_t_zero else [k.slip[rows]]
            at = list_places(group, (k.r, 3), (k.R, 9), (k.v, 6), (k.J_inv, 9))
            steps.append(self._make_loop_step(group, made.code, "rows", *at, *stored))
        return steps

    def load_slopes(self) -> list[Step]:
        """Return the steps that add the slopes of A^T lam by poses to ``by_pose``."""
        k = self._k
        return [
            self._make_loop_step(
                group,
                load_or_make_code("loops.make_row_slope_loops", *group.key),
                "load_slopes",
                k.lam[group.rows],
                *list_places(group, (k.r, 3), (k.R, 9)),
                *self.list_blocks(k.by_pose, group),
            )
            for group in self._groups
        ]

    def rate_slopes(self) -> list[Step]:
        """Return the steps that compute ``rate_slope``, the slopes of phi_dot by poses."""
        k = self._k
        return [
            self._make_loop_step(
                group,
                load_or_make_code("loops.make_row_slope_loops", *group.key),
                "rate_slopes",
                *list_places(group, (k.r, 3), (k.R, 9), (k.v, 6)),
                *(k.rate_slope[e, group.rows] for e in group.ends),
            )
            for group in self._groups
        ]

    def forces(self) -> list[Step]:
        """Return the steps that set ``force`` to the applied forces, less the gyroscopic torque Omega x J Omega."""
        return self._make_load_steps("forces")

    def applied_forces(self) -> list[Step]:
        """Return the steps that set ``force`` to the applied forces alone."""
        return self._make_load_steps("applied")

    def _make_load_steps(self, bodies: str) -> list[Step]:
        """Return the steps that set ``force`` by the loop ``bodies`` over all bodies and add forces of all kinds.

        ``bodies`` is "forces" (weight and gyroscopic torque) or "applied" (weight).
        """
        k, steps = self._k, [self._make_body_step(bodies)]
        for kind, group in self._iterate_force_groups():
            at = [*list_places(group, (k.r, 3), (k.R, 9), (k.v, 6)), *list_places(group, (k.force, 6))]
            steps.append(
                self._make_loop_step(
                    group, load_or_make_code("loops.make_load_loops", kind, group.ends == [0]), "push", *at
                )
            )
        return [*steps, *self._make_user_steps(user_forces.add_user_forces)]

    def _make_body_step(self, name: str) -> Step:
        """Return the step that sets ``force`` by the loop ``name`` over all bodies."""
        s, k = self._system, self._k
        weight = s.mass[:, None] * s.gravity
        return load_or_make_code("loops.make_body_loops").address(name), [np.array([s.nb]), weight, k.J, k.v, k.force]

    def force_slopes(self) -> list[Step]:
        """Return the steps that compute ``by_pose``, ``by_rate``: slopes of ``forces`` by poses and velocities."""
        nb, k = np.array([self._system.nb]), self._k
        turning = load_or_make_code("loops.make_body_loops").address("slopes"), [nb, k.J, k.v, k.by_rate]
        zero, *pushes = self.applied_slopes()
        return [zero, pushes[0], turning, *pushes[1:]]

    def applied_slopes(self) -> list[Step]:
        """Return the steps that compute the slopes of ``applied_forces`` by poses and velocities."""
        return [
            *self._make_slope_steps("spring", "torsion", "load"),
            *self._make_user_steps(user_forces.add_user_slopes),
        ]

    def spring_slopes(self) -> list[Step]:
        """Return the steps that compute the slopes of spring-dampers alone by poses and velocities."""
        return self._make_slope_steps("spring")

    def _make_slope_steps(self, *kinds: str) -> list[Step]:
        """Return the steps that set the slopes to zero and add those of the forces of these ``kinds``."""
        k, zero = self._k, load_or_make_code("loops.make_body_loops").address("zero")
        steps: list[Step] = [(zero, [np.array([a.size]), a]) for a in (k.by_pose, k.by_rate)]
        for kind, group in self._iterate_force_groups():
            if kind in kinds:
                code, at = (
                    load_or_make_code("loops.make_load_slope_loops", kind, group.ends == [0]),
                    [(k.r, 3), (k.R, 9), (k.v, 6)],
                )
                blocks = (x for a in (k.by_pose, k.by_rate) for x in self.list_blocks(a, group))
                steps.append(self._make_loop_step(group, code, "slopes", *list_places(group, *at), *blocks))
        return steps

    def _make_user_steps(self, function: Callable[[Any], None]) -> list[Step]:
        """Return the steps of a compiled ``function`` of user forces; none for a system without user forces."""
        if not len(self._k.users.law):
            return []
        users = BoundFunction(function, self._k)
        self._keeps.append(users)
        return users.steps

    def list_blocks(self, slopes: np.ndarray, group: "ElementGroup", couple: bool = True) -> Iterator[np.ndarray]:
        """Yield the array ``slopes`` and the first index in it of each member's block (6, 6), by pair of ends.

        Pairs are (loaded end, moving end); without ``couple`` only those of an end with itself.
        """
        for a, b in ((a, b) for a in group.ends for b in group.ends if couple or a == b):
            place = [self._place[int(one[a]), int(one[b])] for one in group.body]
            yield from (slopes, 36 * np.array(place, dtype=np.int64))

    def _group_parts(self) -> Iterator["ElementGroup"]:
        """Yield the parts of joints in groups of one kind, in the kernel's order; one loop computes each group."""
        k, parts, at = self._k, self._parts, 0
        while at < len(parts):
            kind, lo, hi, ground, _ = parts[at]
            end = at
            while end < len(parts) and parts[end][:4] == parts[at][:4]:
                end += 1
            numbers = list_joint_parameters(self._system, np.array([part.joint for part in parts[at:end]]))
            key = str(joints.KINDS[kind]), tuple(range(lo, hi)), bool(ground)
            ends, rows = [0] if ground else [0, 1], slice(int(k.row[at]), int(k.row[end]))
            yield ElementGroup(key, k.body[at:end], ends, numbers, np.array([end - at]), rows)
            at = end

    def _iterate_force_groups(self) -> Iterator[tuple[str, "ElementGroup"]]:
        """Yield kind and group of all springs, torsional springs and loads; those with the ground form own groups."""
        for kind in ("spring", "torsion", "load"):
            i = np.asarray(getattr(self._system, f"{kind}_i"), dtype=np.int64)
            j = np.full(len(i), GROUND) if kind == "load" else np.asarray(getattr(self._system, f"{kind}_j"))
            for ground in (False, True):
                own = np.flatnonzero((j == GROUND) == ground)
                if len(own):
                    body = np.stack((i[own], j[own]), axis=1)
                    numbers = list_force_parameters(self._system, kind)[own]
                    ends = [0] if ground else [0, 1]
                    yield kind, ElementGroup((kind, (), ground), body, ends, numbers, np.array([len(own)]), slice(0))


class ElementGroup(NamedTuple):
    """The joints or forces of one kind: code key, bodies, moving ends, parameters, number of members (1,) and rows."""

    key: tuple[str, tuple[int, ...], bool]
    body: np.ndarray
    ends: list[int]
    numbers: np.ndarray
    members: np.ndarray
    rows: slice


def list_places(group: ElementGroup, *arrays: tuple[np.ndarray, int]) -> Iterator[np.ndarray]:
    """Yield, end by end, each array and the first index in it of each member's body, as arguments of a loop.

    ``arrays`` are pairs of an array over all bodies and its number of entries per body.
    """
    for e in group.ends:
        for array, size in arrays:
            yield from (array, np.ascontiguousarray(group.body[:, e] * size))
