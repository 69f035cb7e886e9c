"""Entries of a kernel for mean-value steps: rows and forces between the poses at the start and at the end (compiled).

``rows``: phi at the end, X, Y and way of the mean rows; ``forces``: mean loads, less Omega x J Omega of the mean v.
"""

from collections.abc import Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from ....harness.mechanics import joints
from ....harness.mechanics.system import GROUND, MultibodySystem
from ..generated import Loop, compile_functions
from ..rows.expressions import force_numbers, joint_numbers
from ..rows.loops import body_loop
from ..rows.means import BODY, mean_push_loop, mean_row_loop
from .entries import Program
from .kernel import Kernel, parts_of


class Entry(int):
    """The word of a program, which lives as long as this."""

    program: Program


class Means(NamedTuple):
    """The start of a step, its length, and entries; the end is where the kernel stands, ``v`` the mean velocities."""

    h: Any  # (1,) [s]
    r0: Any  # (nb, 3)
    R0: Any  # (nb, 3, 3)
    rows: int
    forces: int


def make_means(system: MultibodySystem, k: Kernel) -> Means:
    """Mean-value entries on the arrays of ``k``; ValueError on rows without a discrete gradient."""
    h, r0, R0 = np.zeros(1), np.zeros((system.nb, 3)), np.zeros((system.nb, 3, 3))
    arrays = {"r0": r0, "R0": R0, "r": k.r, "R": k.R, "v": k.v, "J_inv": k.J_inv}

    def call(
        loop: Loop, times: Sequence[np.ndarray], numbers: np.ndarray, ends: Sequence[np.ndarray]
    ) -> tuple[int, list[np.ndarray]]:
        code = compile_functions({"mean": loop})
        keeps.append(code)
        blocks = [a for body in ends for name, size in BODY for a in (arrays[name], np.ascontiguousarray(body * size))]
        return code.address("mean"), [np.array([len(numbers)]), *times, numbers, *blocks]

    keeps: list[Any] = []
    rows, parts = [], parts_of(system)
    for (kind, lo, hi, ground), group in groupby(enumerate(parts), key=lambda at: at[1][:4]):
        own = [at for at, _ in group]
        made = mean_row_loop(str(joints.KINDS[kind]), tuple(range(lo, hi)), bool(ground))
        place = slice(int(k.row[own[0]]), int(k.row[own[-1] + 1]))
        if made.way is not None:
            k.way[place] = np.tile(np.array(made.way), (len(own), 1))
        ends = range(1 if ground else 2)
        stored = [k.phi[place], *(k.X[e, place] for e in ends), *(k.Y[e, place] for e in ends)]
        numbers = joint_numbers(system, np.array([parts[at].joint for at in own]))
        address, given = call(made.loop, [h], numbers, [k.body[own, e] for e in ends])
        rows.append((address, [*given, *stored, *([] if made.way is not None else [k.way[place]])]))
    code = compile_functions({"bodies": body_loop(gyroscopic=True)})
    weight = system.mass[:, None] * system.gravity
    forces = [(code.address("bodies"), [np.array([system.nb]), weight, k.J, k.v, k.force])]
    for kind in ("spring", "load"):
        i = np.asarray(getattr(system, f"{kind}_i"))
        j = np.asarray(system.spring_j) if kind == "spring" else np.full(len(i), GROUND)
        for ground in (False, True):
            chosen = np.flatnonzero((j == GROUND) == ground)
            if not len(chosen):
                continue
            bodies = [b[chosen] for b in ((i,) if ground else (i, j))]
            times, numbers = [k.t, h], force_numbers(system, kind)[chosen]
            address, given = call(mean_push_loop(kind, ground), times, numbers, bodies)
            added = [a for b in bodies for a in (k.force, np.ascontiguousarray(b * 6))]
            forces.append((address, [*given, *added]))
    return Means(h, r0, R0, make_entry(rows, (keeps, k)), make_entry(forces, (keeps, code, k)))


def make_entry(steps: Sequence[tuple[int, Sequence[np.ndarray]]], keeps: Any) -> Entry:
    program = Program(steps, keeps)
    entry = Entry(program.entry)
    entry.program = program
    return entry
