"""Compare a mechanism that a reader has made of a file with what another code makes of it: here MuJoCo.

Both sides get the same states: the file's own start and random ones near it. The other code gives positions,
velocities and accelerations of the centre of mass of each body, and the rates of its frame; what the reader names as
omitted is taken away there. Equality constraints of MuJoCo, which it softens, hold exactly here, as joints do.
"""

import importlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from missing_looks import ASSET, LOOKS  # type: ignore[import-not-found]  # beside this file

from mbsbench.harness.formats.mechanisms.mechanism import (
    CompiledMechanism,
    OmittedContents,
    find_joints,
    is_straight_spring,
)
from mbsbench.harness.mechanics.dynamics import accelerations
from mbsbench.harness.mechanics.motion import constraint, constraint_rate
from mbsbench.harness.mechanics.state import State, States
from mbsbench.harness.mechanics.system import MultibodySystem

SAME = 1e-9  # relative difference below which accelerations agree: rounding of both codes
SMALL = 1.0  # [m/s2, rad/s2] accelerations below it are compared absolutely, as of bodies at rest
STATES = 2  # random states beside the start
NEAR = 0.4  # [m, rad, m/s, rad/s] largest coordinates and rates of random states, from the reference ones
RANK = 1e-11  # relative singular value below which rows of loops are redundant
REGULAR = 1e-3  # relative singular value from which on they are independent: rounding over its square is below SAME
TRIES = 9  # random states that are tried for one whose loops can be closed
ITERATIONS = 200  # of Newton's method, with steps up to ``NEAR``, to close loops
CLOSED = 1e-9  # [m, rad] gap from which one more step closes loops to rounding
STEP = 2e-3  # [s] step of differences, of sixth order: its error is below rounding over STEP
STENCIL = {1: 3.0 / 4.0, 2: -3.0 / 20.0, 3: 1.0 / 60.0}  # central weights of sixth order
WITHIN = {OmittedContents.LIMITS, OmittedContents.COLLIDING, OmittedContents.MOCAP}  # rest between stops and contacts


class NotComparableError(ValueError):
    """Signal that the other code gives no motion to compare with; the message says why."""


class SingularPoseError(ValueError):
    """Signal a state at which rows of loops are nearly redundant, or that no iteration brings onto its loops."""


@dataclass(frozen=True)
class Sample:
    """A state as the reader and as the other code have it, and the other code's accelerations."""

    system: MultibodySystem
    ours: State
    theirs: State
    v_dot: np.ndarray  # (nb, 3) [m/s2, space]
    Omega_dot: np.ndarray  # (nb, 3) [rad/s2, body]

    def measure_difference(self) -> float:
        """Return the largest difference of states and accelerations, relative to each body's own from ``SMALL`` on.

        Gaps of joints at the other code's state, and their rates, are differences, too.
        """
        rates = accelerations(self.system, self.ours)
        at = States.one(self.theirs)
        gaps = np.concatenate((constraint(self.system, at)[0], constraint_rate(self.system, at)[0]))
        pairs = [
            (self.ours.r, self.theirs.r),
            (self.ours.R.reshape(-1, 9), self.theirs.R.reshape(-1, 9)),
            (self.ours.v, self.theirs.v),
            (self.ours.Omega, self.theirs.Omega),
            (rates.v_dot, self.v_dot),
            (rates.Omega_dot, self.Omega_dot),
        ]
        return max(
            float(np.max(np.abs(gaps), initial=0.0)),
            *(
                float(np.max(np.linalg.norm(a - b, axis=1) / np.maximum(np.linalg.norm(b, axis=1), SMALL)))
                for a, b in pairs
            ),
        )


class MujocoModel:
    """A MuJoCo model of a file, compiled by MuJoCo alone with its meshes."""

    def __init__(self, path: Path) -> None:
        """Compile the file, with other looks where a mesh or texture is missing; raise NotComparableError if it fails.

        A body whose inertia is that of its mesh then disagrees.
        """
        self.mj = importlib.import_module("mujoco")
        self.left_out = 0  # states near singular poses of loops
        assets: dict[str, bytes] = {}
        while True:
            try:
                self.model = self.mj.MjModel.from_xml_path(str(path), assets)
                break
            except ValueError as error:
                message = " ".join(str(error).split())
                missing = ASSET.search(message)
                if missing is None or missing[0] in assets:
                    raise NotComparableError(message) from None
                assets[missing[0]] = LOOKS[missing[1].lower()]
        self.model.opt.jacobian = self.mj.mjtJacobian.mjJAC_DENSE

    def remove(self, omitted: set[str]) -> None:
        """Take away from the model the kinds of parts that a reader names as omitted."""
        mj, m, kinds = self.mj, self.model, OmittedContents
        ours, first = find_joints(mj, m), m.jnt_dofadr
        bent = [k for k in range(m.ntendon) if not is_straight_spring(mj, m, k)]

        def clear(values: np.ndarray, kept: tuple[int, ...] = ()) -> None:
            """Set the values of the joints or their degrees of freedom to 0 but for those of joints ``kept``."""
            at = set(kept) if len(values) == m.njnt else {first[k] for k in kept}
            values[[k for k in range(len(values)) if k not in at]] = 0.0

        if kinds.STIFFNESS in omitted:
            clear(m.jnt_stiffness, (*ours.turning_springs, *ours.sliding_springs))
            clear(m.jnt_stiffnesspoly, (*ours.turning_springs, *ours.sliding_springs))
        if kinds.DAMPING in omitted:
            clear(m.dof_damping, (*ours.turning_dampers, *ours.sliding_dampers))
            clear(m.dof_dampingpoly, (*ours.turning_dampers, *ours.sliding_dampers))
        if kinds.ARMATURE in omitted:
            clear(m.dof_armature, ours.armatures)
            m.tendon_armature[:] = 0.0
        if kinds.FRICTION in omitted:
            m.dof_frictionloss[:] = m.tendon_frictionloss[:] = 0.0
        if kinds.TENDONS in omitted:
            for values in (m.tendon_stiffness, m.tendon_stiffnesspoly, m.tendon_damping, m.tendon_dampingpoly):
                values[bent] = 0.0
        if kinds.LIFT in omitted:
            m.body_gravcomp[:] = 0.0
        if kinds.FLUID in omitted:
            m.opt.density = m.opt.viscosity = 0.0
        if kinds.ACTUATORS in omitted:  # dampers and rotors of theirs act although actuation is off
            m.actuator_damping[:] = m.actuator_armature[:] = 0.0
            m.actuator_dampingpoly[:] = 0.0
        if kinds.ASLEEP in omitted:
            m.opt.enableflags &= ~int(mj.mjtEnableBit.mjENBL_SLEEP)
        off = {
            kinds.ACTUATORS: mj.mjtDisableBit.mjDSBL_ACTUATION,
            kinds.COLLIDING: mj.mjtDisableBit.mjDSBL_CONTACT,
            kinds.LIMITS: mj.mjtDisableBit.mjDSBL_LIMIT,
        }
        for kind in omitted & set(off):
            m.opt.disableflags |= int(off[OmittedContents(kind)])

    def make_samples(self, mechanism: CompiledMechanism, rng: np.random.Generator) -> Iterator[Sample]:
        """Yield the start, unless its loops are near a singular pose, and random states that are not.

        Raise NotComparableError if there is no such state.
        """
        mj, m, none = self.mj, self.model, np.zeros(self.model.nv)
        for k in range(1 + STATES):
            for _ in range(TRIES if k else 1):
                q, v = np.array(m.qpos0), none
                if k:
                    mj.mj_integratePos(m, q, rng.uniform(-NEAR, NEAR, m.nv), 1.0)
                    v = rng.uniform(-NEAR, NEAR, m.nv)
                try:
                    q = self._close(q)
                    J = self._rows(q)[0]
                    v = v - np.linalg.pinv(J, rcond=RANK) @ (J @ v)
                    moved = self._move(q, v)
                except SingularPoseError:
                    continue
                problem = mechanism.problem(qpos=tuple(map(float, q)), qvel=tuple(map(float, v)))
                yield Sample(problem.system, problem.initial, *moved)
                break
            else:
                self.left_out += 1
        if self.left_out > STATES:
            raise NotComparableError(f"its loops are not closed, or near a singular pose, at {TRIES} random states")

    def _close(self, q: np.ndarray) -> np.ndarray:
        """Return coordinates near ``q`` at which all equality constraints hold, by Newton's iteration.

        Raise SingularPoseError if it does not converge.
        """
        for _ in range(ITERATIONS):
            J, gap = self._rows(q)
            largest = np.max(np.abs(gap), initial=0.0)
            if largest == 0.0:
                return q
            step = -np.linalg.pinv(J, rcond=RANK) @ gap
            q = q.copy()
            self.mj.mj_integratePos(self.model, q, step * min(1.0, NEAR / max(NEAR, np.max(np.abs(step)))), 1.0)
            if largest < CLOSED:  # this last step has reached rounding
                return q
        raise SingularPoseError

    def _rows(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return Jacobian and gaps of the equality constraints at ``q``."""
        mj, m = self.mj, self.model
        d = mj.MjData(m)
        d.qpos[:] = q
        mj.mj_fwdPosition(m, d)
        held = d.efc_type == int(mj.mjtConstraint.mjCNSTR_EQUALITY)
        return d.efc_J.ravel()[: d.nefc * m.nv].reshape(-1, m.nv)[held], d.efc_pos[held]

    def _move(self, q: np.ndarray, v: np.ndarray) -> tuple[State, np.ndarray, np.ndarray]:
        """Return the state of the bodies at MuJoCo's coordinates and velocities, and their accelerations.

        Raise SingularPoseError near a pose where more rows of loops become redundant, and ValueError if rows other than
        equalities act, such as a limit that the reader does not name.
        """
        mj, m = self.mj, self.model
        d = mj.MjData(m)
        d.qpos[:], d.qvel[:] = q, v
        mj.mj_forward(m, d)
        if np.any(d.efc_type != int(mj.mjtConstraint.mjCNSTR_EQUALITY)):
            raise ValueError("a contact, a limit or dry friction acts and is not taken away")
        M = np.zeros((m.nv, m.nv))
        mj.mj_fullM(m, d, M)
        a = np.array(d.qacc_smooth)
        if d.nefc:
            J, J_dot_v = self._rows(q)[0], self._differentiate_rows(q, v) @ v
            L = np.linalg.cholesky(M)
            B = np.linalg.solve(L, J.T).T
            size = np.linalg.svd(J, compute_uv=False)
            if np.any((size > RANK * size[0]) & (size < REGULAR * size[0])):
                raise SingularPoseError
            a = a + np.linalg.solve(L.T, np.linalg.pinv(B, rcond=RANK) @ (-J_dot_v - J @ a))
        roots = [b for b in range(1, m.nbody) if self._find_root(b) == b]
        R = d.xmat[roots].reshape(-1, 3, 3)
        r, speed, turning, v_dot, Omega_dot = np.zeros((5, len(roots), 3))
        for n, root in enumerate(roots):
            parts = [b for b in range(1, m.nbody) if self._find_root(b) == root]
            r[n] = m.body_mass[parts] @ d.xipos[parts] / np.sum(m.body_mass[parts])
            (Jp, Jr), (Dp, Dr) = np.zeros((2, 3, m.nv)), np.zeros((2, 3, m.nv))
            mj.mj_jac(m, d, Jp, Jr, r[n], root)
            mj.mj_jacDot(m, d, Dp, Dr, r[n], root)
            speed[n], turning[n] = Jp @ v, R[n].T @ (Jr @ v)
            v_dot[n], Omega_dot[n] = Jp @ a + Dp @ v, R[n].T @ (Jr @ a + Dr @ v)
        return State(r, R, speed, turning), v_dot, Omega_dot

    def _differentiate_rows(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the rate of the Jacobian of equalities along ``v``, by differences."""
        out = 0.0
        for k, weight in STENCIL.items():
            sides = []
            for sign in (1.0, -1.0):
                at = q.copy()
                self.mj.mj_integratePos(self.model, at, v, sign * k * STEP)
                sides.append(self._rows(at)[0])
            out = out + weight / STEP * (sides[0] - sides[1])
        return np.asarray(out)

    def _find_root(self, b: int) -> int:
        """Return the first body of the rigid group of body ``b``: that which has joints, 0 for the ground."""
        m = self.model
        while b and not m.body_jntnum[b]:
            b = int(m.body_parentid[b])
        return b
