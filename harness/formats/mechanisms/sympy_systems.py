"""Read a system of ``sympy.physics.mechanics`` as a problem: KanesMethod, LagrangesMethod or System, with numbers.

Bodies and their poses are read from it; joints and forces are recognised from the motions that its equations give
(module ``recognition``). The resulting system must have the accelerations of the equations in random states.
"""

import importlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from ...mechanics.consistency import close_gaps, project
from ...mechanics.dynamics import accelerations
from ...mechanics.state import State
from ...mechanics.system import RigidBody, assemble
from ...mechanics.types import Problem
from .mechanism import NEAR, T_END
from .recognition import Sample, find_forces, find_joints

SAME = 1e-10  # allowed difference of accelerations, relative to the largest
STATES = 24  # sampled states from which joints and forces are recognised
CLOSED = 1e-13  # tolerance of configuration constraints
REACH = 0.3  # spread of random coordinates about the start [m or rad]


def read_sympy(
    method: Any,
    values: Mapping[Any, Any],
    start: Mapping[Any, float],
    *,
    t_end: float = T_END,
    dt: float = 1e-3,
    name: str = "sympy",
    bodies: Sequence[Any] = (),
    origin: Any = None,
) -> Problem:
    """Return the problem of a KanesMethod, LagrangesMethod or System; raise ValueError if it cannot be represented.

    ``values`` has numbers for its symbols, ``start`` for its coordinates and, if not 0, its speeds. A LagrangesMethod
    also needs its ``bodies``; ``origin`` is a point at rest, needed if no such point has a position to the first mass.
    The problem ends at ``t_end`` [s] and has the default step ``dt`` [s].
    """
    for what, numbers in (("values", values), ("start", start)):
        _check_numbers(what, numbers)
    e = _Equations(method, dict(values), tuple(bodies), origin)
    known = [*e.q, *e.u]
    for symbol in start:
        if symbol not in known:
            raise ValueError(f"start: {symbol} is not one of {', '.join(map(str, known))}")
    if lacking := [str(c) for c in e.q if c not in start]:
        raise ValueError(f"start lacks {', '.join(lacking)}")
    q, u = (np.array([float(start.get(c, 0.0)) for c in some]) for some in (e.q, e.u))
    samples = e.draw_samples(q)
    joints, known_joints = find_joints(e.bodies, samples)
    forces = find_forces(e.bodies, known_joints, samples)
    system = assemble(e.bodies, joints, forces.gravity, forces.springs, torsions=forces.torsions)
    for one in samples[:4]:
        rates = accelerations(system, one.state)
        off = np.abs(np.hstack((rates.v_dot, rates.Omega_dot)) - one.acceleration)
        if np.max(off) > SAME * (1.0 + np.max(np.abs(one.acceleration))):
            body = e.bodies[int(np.argmax(np.max(off, axis=1)))].name
            raise ValueError(f"the acceleration of body {body!r} is off that of the equations by {np.max(off):.2g}")
    state = e.state(q, u)
    initial = project(system, state) if len(e.closing) else state
    kind, version = type(method).__name__, importlib.import_module("sympy").__version__
    return Problem(name, system, initial, t_end, dt, "", f"{kind} of SymPy {version}, joints and forces recognised")


def _check_numbers(what: str, numbers: Any) -> None:
    """Raise ValueError unless the argument called ``what`` is a dict with a finite number for each symbol."""
    if not isinstance(numbers, Mapping):
        raise ValueError(f"{what}: expected a dict of numbers by symbol (got {numbers!r})")
    for symbol, x in numbers.items():
        try:
            finite = math.isfinite(float(x))
        except (TypeError, ValueError, OverflowError):
            finite = False
        if not finite:
            raise ValueError(f"{what}: {symbol} must be a finite number (got {x!r})")


@dataclass(frozen=True)
class _Equations:
    """The equations of SymPy, evaluated in numbers at their coordinates q and speeds u."""

    given: Any  # KanesMethod, LagrangesMethod or System
    values: dict[Any, Any]  # numbers by symbol
    own_bodies: tuple[Any, ...]  # as the user gives them; empty: those of the system
    point: Any  # at rest, as the user gives it, or None

    @cached_property
    def method(self) -> Any:
        """The equations of motion; those of a System are formed first if necessary."""
        kind = type(self.given).__name__
        if kind not in ("System", "KanesMethod", "LagrangesMethod"):
            raise ValueError(f"expected a KanesMethod, a LagrangesMethod or a System of SymPy (got {kind})")
        if kind != "System":
            return self.given
        if self.given.eom_method is None:
            self.given.form_eoms()
        return self.given.eom_method

    @cached_property
    def sympy_modules(self) -> tuple[Any, Any]:
        """The modules ``sympy`` and ``sympy.physics.mechanics``, imported when needed."""
        return importlib.import_module("sympy"), importlib.import_module("sympy.physics.mechanics")

    @cached_property
    def q(self) -> list[Any]:
        """Symbols of the coordinates."""
        return list(self.method.q)

    @cached_property
    def u(self) -> list[Any]:
        """Symbols of the speeds."""
        return list(self.method.u)

    @property
    def is_lagrange(self) -> bool:
        """True for a LagrangesMethod, whose speeds are the rates of its coordinates."""
        return hasattr(self.method, "coneqs")

    @cached_property
    def closing(self) -> Any:
        """The configuration constraints: a column of expressions in q that vanish where loops are closed."""
        found = self.method._hol_coneqs if self.is_lagrange else self.method._f_h
        return self.sympy_modules[0].Matrix(list(found))

    @cached_property
    def parts(self) -> tuple[Any, ...]:
        """SymPy's bodies and particles except the ground; raise ValueError if they are not known."""
        found = self.own_bodies or tuple(getattr(self.given, "bodies", None) or ())
        if not found:
            raise ValueError("its bodies are not known: give bodies=[...], its RigidBody and Particle objects")
        return tuple(b for b in found if getattr(b, "frame", None) != self.frame)  # the newtonian body is the ground

    @cached_property
    def frame(self) -> Any:
        """SymPy's inertial frame; raise ValueError if the equations do not name it."""
        for holder, slot in ((self.given, "frame"), (self.method, "_inertial"), (self.method, "inertial")):
            if (found := getattr(holder, slot, None)) is not None:
                return found
        raise ValueError("its frame at rest is not known: LagrangesMethod(..., frame=N)")

    @cached_property
    def bodies(self) -> list[RigidBody]:
        """The rigid bodies, with mass [kg] and inertia about C [kg m2, body], in the order of ``parts``."""
        out = []
        for b in self.parts:
            J = self.sympy_modules[0].zeros(3, 3) if self._is_point(b) else b.central_inertia.to_matrix(b.frame)
            m, *entries = self._compile([b.mass, *J])(*np.zeros(len(self.q) + len(self.u))).ravel()
            out.append(RigidBody(float(m), np.array(entries, dtype=float).reshape(3, 3), str(b.name)))
        return out

    def _is_point(self, b: Any) -> bool:
        """Return whether a part is a particle, which has a point and no frame of its own."""
        return not hasattr(b, "central_inertia")

    @cached_property
    def origin(self) -> Any:
        """A point at rest: the one given, or the nearest that SymPy's positions connect to the first mass.

        Raise ValueError if there is none.
        """
        if self.point is not None:
            return self.point
        if (fixed := getattr(self.given, "fixed_point", None)) is not None:
            return fixed
        seen = [self.parts[0].masscenter if hasattr(self.parts[0], "masscenter") else self.parts[0].point]
        for p in seen:
            if p._vel_dict.get(self.frame) == 0:
                return p
            seen += [n for n in p._pos_dict if n not in seen]
        raise ValueError(f"no point at rest has a position to the mass of {self.parts[0].name}: give origin=O")

    def _compile(self, expressions: Any) -> Any:
        """Return a function of the numbers (*q, *u) that evaluates SymPy's ``expressions`` with the given values.

        Raise ValueError, which names them, for symbols without a value, and if time occurs explicitly.
        """
        sp, me = self.sympy_modules
        names = sp.symbols(f"x:{len(self.q) + len(self.u)}", cls=sp.Dummy)
        matrix = sp.Matrix(expressions) if not hasattr(expressions, "shape") else expressions
        rates = {} if self.is_lagrange else self.method.kindiffdict()
        plain = dict(zip([*self.u, *self.q], [*names[len(self.q) :], *names[: len(self.q)]], strict=True))
        out = me.msubs(me.msubs(me.msubs(matrix, rates), self.values), plain)
        lacking = {*out.free_symbols, *out.atoms(sp.core.function.AppliedUndef)} - {*names}
        time = me.dynamicsymbols._t
        if lacking := {s for s in lacking if s != time and s not in plain}:
            raise ValueError(f"values lacks {', '.join(sorted(map(str, lacking)))}")
        if out.has(time):
            raise ValueError("a motion or force is prescribed as a function of time: that is not supported")
        return sp.lambdify(names, out, "numpy", cse=True)

    @cached_property
    def _functions(self) -> dict[str, Any]:
        """The compiled functions of the numbers (*q, *u), by name; a matrix without rows has no function."""
        sp, me = self.sympy_modules
        t = me.dynamicsymbols._t
        x: list[Any] = []
        for b in self.parts:
            point = b.point if self._is_point(b) else b.masscenter
            x += [*point.pos_from(self.origin).to_matrix(self.frame)]
            x += [*(sp.eye(3) if self._is_point(b) else self.frame.dcm(b.frame))]
        poses, q = sp.Matrix(x), sp.Matrix(self.q)
        rates = {} if self.is_lagrange else self.method.kindiffdict()
        q_dot = sp.Matrix([me.msubs(c.diff(t), rates) for c in self.q])
        w = sp.Matrix(sp.symbols(f"w:{len(self.q)}", cls=sp.Dummy))
        jacobian_of_poses, u = poses.jacobian(q), sp.Matrix(self.u)
        bias = me.msubs((jacobian_of_poses * w).jacobian(q) * w, dict(zip(w, q_dot, strict=True)))
        m = self.method
        of_kane = [] if self.is_lagrange or not len(m._k_nh) else m._k_nh * u + m._f_nh
        speed_conditions = sp.Matrix([*(m.coneqs if self.is_lagrange else of_kane)])
        closing = self.closing
        matrices = {
            "poses": poses,  # C and R of each part: 12 numbers
            "pose_jacobian": jacobian_of_poses,  # d poses / d q
            "pose_bias": bias,  # second derivative of poses where q_ddot = 0
            "q_dot": q_dot,
            "q_bias": q_dot.jacobian(q) * q_dot,  # q_ddot where u_dot = 0
            "q_jacobian": q_dot.jacobian(u),  # d q_dot / d u
            "mass": m.mass_matrix_full,  # mass (q_dot, u_dot) = force
            "force": m.forcing_full,
            "gaps": closing,  # 0 where loops are closed
            # d closing / d q
            "gap_jacobian": closing.jacobian(q) if len(closing) else sp.zeros(0, len(self.q)),
            # rows that vanish with each change of u that constraints allow
            "speed_rows": speed_conditions.jacobian(u) if len(speed_conditions) else sp.zeros(0, len(self.u)),
        }
        return {k: self._compile(v) for k, v in matrices.items() if v.shape[0]}

    def _evaluate(self, name: str, q: np.ndarray, u: np.ndarray | None = None) -> np.ndarray:
        """Return the matrix ``name`` of ``_functions`` at q and u (None: zero); without rows if it does not exist."""
        found = self._functions.get(name)
        u = np.zeros(len(self.u)) if u is None else u
        return np.zeros((0, len(q))) if found is None else np.array(found(*q, *u), dtype=float)

    def _compute_velocities(self, q: np.ndarray, q_dot: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return R, v [m/s, space], Omega [rad/s, body] and R_dot of all parts at coordinates q and rates q_dot."""
        x, x_dot = (a.reshape(-1, 12) for a in (self._evaluate("poses", q), self._evaluate("pose_jacobian", q) @ q_dot))
        R, R_dot = (a[:, 3:].reshape(-1, 3, 3) for a in (x, x_dot))
        return R, x_dot[:, :3], _vee(np.swapaxes(R, 1, 2) @ R_dot), R_dot

    def state(self, q: np.ndarray, u: np.ndarray) -> State:
        """Return poses and velocities of all parts at coordinates q and speeds u."""
        R, v, Omega, _ = self._compute_velocities(q, self._evaluate("q_dot", q, u).ravel())
        return State(self._evaluate("poses", q).reshape(-1, 12)[:, :3], R, v, Omega)

    def draw_samples(self, start: Float[np.ndarray, " nq"]) -> list[Sample]:
        """Return up to ``STATES`` samples, the first at coordinates ``start``, the others at random ones near it.

        All have closed loops and random speeds that the constraints allow; coordinates whose loops do not close are
        left out. Raise ValueError if they do not close at the first.
        """
        from scipy.linalg import null_space

        random, out = np.random.default_rng(0), list[Sample]()
        # closer to the start, where a loop does not reach so far
        for reach in (0.0, *np.geomspace(REACH, 0.1 * REACH, 4 * STATES)):
            q = self._close_loops(start + reach * random.standard_normal(len(start)))
            if np.max(np.abs(self._evaluate("gaps", q)), initial=0.0) > CLOSED:
                if not out:
                    raise ValueError("no pose near the start satisfies its configuration constraints")
                continue
            C = self._evaluate("speed_rows", q)
            free = null_space(C, rcond=NEAR) if len(C) else np.eye(len(self.u))
            out.append(self._make_sample(q, free @ random.standard_normal(free.shape[1]), free))
            if len(out) == STATES:
                break
        return out

    def _make_sample(self, q: np.ndarray, u: np.ndarray, free: np.ndarray) -> Sample:
        """Return the sample at q and u: poses and velocities, allowed twists, and accelerations by SymPy's equations.

        The columns of ``free`` span the speeds that the constraints allow. Raise ValueError if the mass matrix is
        singular.
        """
        nq, state = len(q), self.state(q, u)
        try:
            full = np.linalg.solve(self._evaluate("mass", q, u), self._evaluate("force", q, u).ravel())
        except np.linalg.LinAlgError:
            raise ValueError("the mass matrix of its equations is singular, as with a mass or length of 0") from None
        q_dot = self._evaluate("q_dot", q, u).ravel()
        q_ddot = self._evaluate("q_bias", q, u).ravel() + self._evaluate("q_jacobian", q, u) @ full[nq : nq + len(u)]
        bias = self._evaluate("pose_bias", q, u).ravel()
        x_ddot = (bias + self._evaluate("pose_jacobian", q) @ q_ddot).reshape(-1, 12)
        R, _, _, R_dot = self._compute_velocities(q, q_dot)
        R_ddot = x_ddot[:, 3:].reshape(-1, 3, 3)
        spin = _vee(np.swapaxes(R, 1, 2) @ R_ddot + np.swapaxes(R_dot, 1, 2) @ R_dot)
        twists = []
        for column in (self._evaluate("q_jacobian", q) @ free).T:
            _, v, Omega, _ = self._compute_velocities(q, column)
            twists.append(np.hstack((v, Omega)).ravel())
        return Sample(state, np.array(twists).reshape(-1, 6 * len(self.parts)).T, np.hstack((x_ddot[:, :3], spin)))

    def _close_loops(self, q: np.ndarray) -> np.ndarray:
        """Return q after Newton's iteration to close the loops, which ends after 50 steps even if they are open."""
        move = lambda q, gap: q - np.linalg.lstsq(self._evaluate("gap_jacobian", q), gap, rcond=None)[0]  # noqa: E731
        return close_gaps(q, lambda q: self._evaluate("gaps", q).ravel(), move, 0.1 * CLOSED, 50)


def _vee(W: Float[np.ndarray, "nb 3 3"]) -> Float[np.ndarray, "nb 3"]:
    """Return the vectors w of matrices W = hat(w); only the skew-symmetric part of each W counts."""
    return 0.5 * np.stack((W[:, 2, 1] - W[:, 1, 2], W[:, 0, 2] - W[:, 2, 0], W[:, 1, 0] - W[:, 0, 1]), axis=1)
