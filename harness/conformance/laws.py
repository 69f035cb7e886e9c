"""The laws that a problem and its exact motion must satisfy: each returns the number measured.

They are those of the full system in (r, R), which the problem's own formulas do not enter.
"""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..catalogue import registry
from ..mechanics import motion, so3
from ..mechanics.consistency import START_TOLERANCE, InconsistentStart, check_start
from ..mechanics.dynamics import RANK
from ..mechanics.jacobian import constraint_jacobian
from ..mechanics.state import State, States
from ..mechanics.system import MultibodySystem
from ..metrics.scales import Scales, scales
from ..reference.computation import compute_reference, is_computable
from ..results.findings import Finding, compare, fail, leave_open
from ..types import Invariant, Observable, Problem, Reference

FIELDS = ("r", "R", "v", "Omega")  # of a state
SAMPLES = 21  # times along the reference
SMALL = 1e-8  # of the problem's own scales: what is exact may be off by, its stated error apart
DIFFERENCED = 1e-8  # the same for what is differenced: (step x rate)^6 is below 1e-12
ROUNDED = 1e-12  # what rounding leaves of a smooth motion, before it is divided by a step
DIFFERENCE = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0  # sixth order, of samples a step apart


@dataclass(frozen=True)
class Subject:
    """The problem with what several requirements need of it."""

    name: str

    @cached_property
    def problem(self) -> Problem:
        """The problem with its defaults."""
        return registry.make_problem(self.name)

    @cached_property
    def size(self) -> Scales:
        """Scales that drifts are compared with."""
        return scales(self.problem, self.reference)

    @cached_property
    def reference(self) -> Reference | None:
        """Its exact motion."""
        return self.problem.reference()

    @cached_property
    def computed_reference(self) -> Reference | None:
        """The motion that two formulations compute, which know nothing of the problem's own reference."""
        p = self.problem
        end = p.t_end if self.reference is None else min(p.t_end, self.reference.horizon)
        known = is_computable(p.system) and not p.literal_start
        return compute_reference(dataclasses.replace(p, t_end=end)) if known else None

    @cached_property
    def best_reference(self) -> Reference | None:
        """Its own exact motion, else the computed one."""
        return self.reference if self.reference is not None else self.computed_reference

    @cached_property
    def t(self) -> np.ndarray:
        """Times within the horizon of what is known."""
        assert self.best_reference is not None
        return np.linspace(0.0, min(self.problem.t_end, self.best_reference.horizon), SAMPLES)

    @cached_property
    def best_states(self) -> States:
        """The motion at ``t``."""
        assert self.best_reference is not None
        return self.best_reference.states(self.t)

    @cached_property
    def stated_error(self) -> np.ndarray:
        """Stated error at ``t`` [m]."""
        assert self.best_reference is not None
        return np.asarray(self.best_reference.error(self.t), dtype=float)

    @property
    def largest_error(self) -> float:
        """Largest stated error [m]."""
        own = self.stated_error
        return float(np.max(own)) if own.shape == self.t.shape and np.all(np.isfinite(own)) else 0.0

    @cached_property
    def rate(self) -> float:
        """[rad/s] of the motion: how fast poses change, and with them what is made of them.

        Bodies that turn little, as a point mass on a link, cross the motion's length at their speed.
        """
        crossing = float(np.max(np.linalg.norm(self.best_states.v, axis=-1))) / self.size.length
        return 1.0 / max(self.t[-1], 1e-9) + max(float(np.max(np.abs(self.best_states.Omega))), crossing)

    @property
    def allowed_share(self) -> float:
        """The share of its scales by which an exact motion with that stated error may be off."""
        return SMALL + 100.0 * self.largest_error / self.size.length

    def allowed_difference(self, step: float) -> float:
        """The allowed share for derivatives, taken from differences over ``step`` [s]."""
        return DIFFERENCED + (ROUNDED + 100.0 * self.largest_error / self.size.length) / (step * self.rate)


def check_documentation(s: Subject) -> Finding:
    """Docstring, a meaning for each parameter of its own, source and name."""
    entry = registry.problems()[s.name]
    own = {k: p for k, (_, p) in entry.parameters.items() if k not in registry.COMMON_PARAMETERS}
    missing = [] if entry.doc.strip() else ["the docstring of its function"]
    missing += [f"the meaning of {k}" for k, p in own.items() if not p.doc.strip()]
    missing += [what for what in ("source", "name") if not getattr(s.problem, what).strip()]
    named = s.problem.name == s.name
    words = ", ".join(missing) if missing or named else f"it calls itself {s.problem.name!r}"
    return compare(len(missing), "texts missing", most=0, words=words, good=named)


def check_initial_state(s: Subject) -> Finding:
    """phi and phi_dot of the start vanish, as every solver checks before its first step."""
    made = registry.problems()[s.name].make()
    try:
        check_start(made.system, made.initial)
        words, good = _count_freedom(made), True
    except InconsistentStart as error:
        words, good = str(error), False
    one = States.one(made.initial)
    off = [motion.constraint(made.system, one), motion.constraint_rate(made.system, one)]
    gap = max(float(np.max(np.abs(a), initial=0.0)) for a in off)
    return compare(gap, "m or m/s", most=START_TOLERANCE, words=words, good=good)


def _count_freedom(made: Problem) -> str:
    """Rows of its joints, their rank and degrees of freedom at the start: singular values of rows of length one."""
    system = made.system
    A = constraint_jacobian(system, made.initial).toarray()
    length = np.linalg.norm(A, axis=1, keepdims=True)
    size = np.linalg.svd(A / np.where(length > 0.0, length, 1.0), compute_uv=False)
    rank = int(np.sum(size > RANK * np.max(size, initial=0.0)))
    words = f"{system.nrows} rows of rank {rank}: {6 * system.nb - rank} degrees of freedom at the start"
    if rank == system.nrows:
        return words
    names = [system.joint_names[k] for k in find_redundant_joints(system, made.initial)]
    return f"{words}; {system.nrows - rank} rows fewer in {', '.join(names)} would do"


def find_redundant_joints(system: MultibodySystem, state: State) -> list[int]:
    """The fewest joints, or nearly, that can lose all redundant rows: those of the others are independent.

    Joints with few rows first, each is kept whose rows are independent of those kept before.
    """
    A = constraint_jacobian(system, state).toarray()
    length = np.linalg.norm(A, axis=1, keepdims=True)
    A = A / np.where(length > 0.0, length, 1.0)
    rows = [np.arange(system.row_start[k], system.row_start[k + 1]) for k in range(system.nj)]
    kept: list[int] = []
    for k in sorted(range(system.nj), key=lambda k: len(rows[k])):
        both = A[np.concatenate([rows[j] for j in (*kept, k)])]
        size = np.linalg.svd(both, compute_uv=False)
        if len(both) <= len(A.T) and size[-1] > RANK * size[0]:
            kept.append(k)
    return [k for k in range(system.nj) if k not in kept]


def check_times(s: Subject) -> Finding:
    """0 < dt <= t_end [s], finite."""
    p = s.problem
    good = all(math.isfinite(x) and x > 0.0 for x in (p.t_end, p.dt))
    return compare(p.t_end / p.dt if good else math.nan, "steps", 1.0, words=f"t_end = {p.t_end}, dt = {p.dt}")


def check_energy_scale(s: Subject) -> Finding:
    """T + V of the start and the scale of energy [J] are finite, the scale above zero."""
    E = float(motion.energy(s.problem.system, States.one(s.problem.initial))[0])
    good = math.isfinite(E) and math.isfinite(s.size.energy) and s.size.energy > 0.0
    return compare(s.size.energy, "J", words=f"T + V = {E:.6g} J at the start", good=good)


def check_scalars(s: Subject) -> Finding:
    """Observables and invariants take states (nt,) at home to (nt,) finite numbers, equal for equal states."""
    p = s.problem
    scalars: list[Observable | Invariant] = [*p.observables, *p.invariants]
    for names in ([m.name for m in p.observables], [m.name for m in p.invariants]):
        if len(set(names)) < len(names) or not all(n.isidentifier() for n in names):
            return fail(f"names must be different words of letters, digits and _ (got {', '.join(map(repr, names))})")
    one = p.home(States.one(p.initial))
    many = States(*(np.repeat(getattr(one, f), 3, axis=0) for f in FIELDS))
    for m in scalars:
        if not isinstance(m.unit, str):
            return fail(f"{m.name}: unit must be text (got {m.unit!r})")
        values = np.asarray(m.of(many))
        if values.shape != (3,) or not np.all(np.isfinite(values)) or np.ptp(values) > 0.0:
            expected = "of three equal states expected three equal finite numbers"
            return fail(f"{m.name}: {expected} (got {values.tolist()})")
    return compare(len(scalars), "tried") if scalars else leave_open("there are none")


def check_repeatability(s: Subject) -> Finding:
    """Made twice, start, masses and reference agree bit for bit."""
    again = registry.make_problem(s.name)
    reference = again.reference()
    if (reference is None) != (s.reference is None):
        return fail("the reference comes and goes")
    pairs = {f"initial {f}": (getattr(s.problem.initial, f), getattr(again.initial, f)) for f in FIELDS}
    pairs["masses"] = s.problem.system.mass, again.system.mass
    if reference is not None:
        pairs["the reference"] = s.best_states.r, reference.states(s.t).r
    return _compare_worst(
        {name: (float(np.max(np.abs(a - b), initial=0.0)), "") for name, (a, b) in pairs.items()}, 0.0
    )


def check_turned(s: Subject) -> Finding:
    """Observables of the start, seen from home, agree to 1e-9 in a frame turned by exp(0.3, -0.2, 0.5)."""
    turned = registry.make_problem(s.name, {"rotation": (0.3, -0.2, 0.5)})  # checks the turned start
    here = s.problem.observe(States.one(s.problem.initial))
    there = turned.observe(States.one(turned.initial))
    found = {}
    for name in here:
        a, b = (float(np.ravel(values[name])[0]) for values in (here, there))
        words = f"is {a:.6g} at the start, {b:.6g} when everything is turned"
        found[name] = abs(a - b) / (1.0 + s.size.length + abs(a)), words
    return _compare_worst(found, 1e-9)


def check_stated_error(s: Subject) -> Finding:
    """The reference's error(t) [m] is finite, >= 0 and below a thousandth of the size; route and horizon are given."""
    assert s.reference is not None
    own = s.stated_error
    if own.shape != s.t.shape or not np.all(np.isfinite(own)) or np.any(own < 0.0):
        return fail(f"error(t) must be {len(s.t)} finite numbers >= 0 for as many times (got {own.tolist()[:3]} ...)")
    good = bool(s.reference.route.strip()) and s.reference.horizon > 0.0
    words = f"route {s.reference.route!r}, horizon {s.reference.horizon:g} s"
    return compare(float(own.max()), "m", most=1e-3 * s.size.length, words=words, good=good)


def check_reference_start(s: Subject) -> Finding:
    """The reference begins with r, R, v (space) and Omega (body) of the start."""
    p, rate, found = s.problem, s.rate, {}
    units = {"r": s.size.length, "R": 1.0, "v": s.size.length * rate, "Omega": rate}
    for name, unit in units.items():
        gap = float(np.max(np.abs(getattr(s.best_states[0], name) - getattr(p.initial, name)), initial=0.0))
        found[name] = gap / unit, f"differs by {gap:.3g} at t = 0"
    return _compare_worst(found, s.allowed_share)


def check_independent(s: Subject) -> Finding:
    """Positions and angles (times radii of gyration) of the two motions differ by their stated errors at most."""
    if s.computed_reference is None:
        return leave_open("none can be computed for this system")
    t = s.t[s.t <= s.computed_reference.horizon]
    here, there, radius = s.best_states.at(slice(len(t))), s.computed_reference.states(t), s.problem.system.gyration
    turned = radius * np.linalg.norm(here.R - there.R, axis=(-2, -1)) / np.sqrt(2.0)
    gap = np.max(np.maximum(np.linalg.norm(here.r - there.r, axis=-1), turned), axis=-1)
    beyond = np.maximum(gap - s.stated_error[: len(t)] - s.computed_reference.error(t), 0.0)
    words = f"r and R are {np.max(gap):.3g} m apart up to {t[-1]:.3g} s"
    return _compare_worst({"": (float(np.max(beyond)) / s.size.length, words)}, SMALL)


def check_joints(s: Subject) -> Finding:
    """phi [m] and R^T R - 1 vanish along the reference, to its stated error."""
    phi = float(np.max(np.abs(motion.constraint(s.problem.system, s.best_states)), initial=0.0))
    defect = float(np.max(so3.orthogonality_defect(s.best_states.R)))
    joints = phi / max(s.size.length, 1.0), f"reaches {phi:.3g}"
    return _compare_worst({"|phi|": joints, "|R^T R - 1|": (defect, f"reaches {defect:.3g}")}, s.allowed_share)


def check_energy(s: Subject) -> Finding:
    """T + V [J] is constant along the reference, where no damper, no load and no drive acts."""
    if not s.problem.system.is_conservative:
        return leave_open("a damper, a load or a drive acts")
    spread = float(np.ptp(motion.energy(s.problem.system, s.best_states)))
    return _compare_worst(
        {"T + V": (spread / s.size.energy, f"changes by {spread:.3g} J, of {s.size.energy:.3g} J")}, s.allowed_share
    )


def check_invariants(s: Subject) -> Finding:
    """Each invariant is constant along the motion, compared with the scale of its unit."""
    if s.best_reference is None:
        return leave_open("no reference, and none can be computed")
    at_home, found = s.problem.home(s.best_states), {}
    for kept in s.problem.invariants:
        values = np.asarray(kept.of(at_home))
        scale = s.size.of_unit(kept.unit)
        scale = scale if math.isfinite(scale) else max(float(np.max(np.abs(values))), 1e-3)
        spread = float(np.ptp(values))
        found[kept.name] = spread / scale, f"changes by {spread:.3g} {kept.unit}, of {scale:.3g}"
    return _compare_worst(found, 10.0 * s.allowed_share)


def _compare_worst(found: Mapping[str, tuple[float, str]], most: float) -> Finding:
    """The largest of some shares of their scales, by what they are of; NaN is the largest."""
    if not found:
        return leave_open("there are none")
    name = max(found, key=lambda k: (math.isnan(found[k][0]), found[k][0]))
    share, words = found[name]
    return compare(share, "of its scale", most=most, words=f"{name} {words}".rstrip())


def _sample_around(s: Subject) -> tuple[list[States], float]:
    """The reference around some of its times, a step apart, and the step [s]."""
    assert s.reference is not None
    step = min(1e-2 / s.rate, s.t[-1] / 100.0)
    t = s.t[3:-3:4]
    return [s.reference.states(t + k * step) for k in range(-3, 4)], step


def check_rates(s: Subject) -> Finding:
    """dr/dt = v (space) and dR/dt = R hat(Omega) (body), from differences of sixth order."""
    near, step = _sample_around(s)
    r_dot, R_dot = (np.tensordot(DIFFERENCE, [getattr(x, f) for x in near], 1) / step for f in ("r", "R"))
    here = near[3]
    v = float(np.max(np.abs(r_dot - here.v)))
    Omega = float(np.max(np.abs(R_dot - here.R @ so3.hat(here.Omega))))
    found = {
        "dr/dt - v": (v / s.size.length / s.rate, f"reaches {v:.3g} m/s"),
        "dR/dt - R hat(Omega)": (Omega / s.rate, f"reaches {Omega:.3g} 1/s"),
    }
    return _compare_worst(found, s.allowed_difference(step))


def check_newton_euler(s: Subject) -> Finding:
    """Newton and Euler: m dv/dt and J dOmega/dt + Omega x J Omega less what is applied are in the range of A^T."""
    system = s.problem.system
    near, step = _sample_around(s)
    v_dot, W_dot = (np.tensordot(DIFFERENCE, [getattr(x, f) for x in near], 1) / step for f in ("v", "Omega"))
    acceleration = float(np.linalg.norm(system.gravity)) + s.size.length * s.rate**2
    scale, worst = float(np.sum(system.mass)) * acceleration * max(1.0, s.size.length), []
    for k in range(len(near[3])):
        here = near[3][k]
        momentum = np.einsum("bij,bj->bi", system.inertia, here.Omega)
        torque = np.einsum("bij,bj->bi", system.inertia, W_dot[k]) + np.cross(here.Omega, momentum)
        inert = np.concatenate((system.mass[:, None] * v_dot[k], torque), axis=1)
        left = wrench = (inert - motion.applied_loads(system, States.one(here))[0]).ravel()
        if system.nrows:
            A = constraint_jacobian(system, here).toarray()
            left = A.T @ np.linalg.lstsq(A.T, wrench, rcond=1e-10)[0] - wrench
        worst.append(float(np.max(np.abs(left))))
    top = float(np.max(worst))
    found = {"m a - f": (top / scale, f"has {top:.3g} N (or N m) that are not joint forces")}
    return _compare_worst(found, 10.0 * s.allowed_difference(step))
