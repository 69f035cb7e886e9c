"""Measure the laws that a problem and its exact motion must satisfy, one number per law.

They are laws of the full system in (r, R), independent of the problem's own formulas.
"""

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ...catalogue import registry
from ...columns.measured import Scales
from ...mechanics import motion, so3
from ...mechanics.consistency import START_TOLERANCE, InconsistentStart, check_start
from ...mechanics.dynamics import RANK
from ...mechanics.jacobian import constraint_jacobian
from ...mechanics.naming import name_joint
from ...mechanics.state import State, States
from ...mechanics.system import MultibodySystem
from ...mechanics.types import JUDGED, Invariant, Observable, Problem, Reference
from ...reference.computation import compute_reference, is_computable
from ...results.findings import Finding, judge_value, leave_open, make_failure
from ...results.words import describe_span
from ..distance import measure_distance
from ..invariance import TURNED
from ..law import PRODUCTS, SMALL, compute_derivative_tolerance, compute_law_tolerance, judge_largest_error
from ..metrics.scales import find_scales

FIELDS = ("r", "R", "v", "Omega")  # fields of a state
SAMPLES = 21  # times along the reference
# derivative of sixth order from samples a step apart
DIFFERENCE = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0


@dataclass(frozen=True)
class Subject:
    """A problem with the quantities that several requirements use."""

    name: str

    @cached_property
    def problem(self) -> Problem:
        """The problem with its defaults."""
        return registry.make_problem(self.name)

    @cached_property
    def size(self) -> Scales:
        """The scales of length, energy and others that errors and drifts are compared with."""
        return find_scales(self.problem, self.reference)

    @cached_property
    def reference(self) -> Reference | None:
        """The exact motion that the problem states itself; None if it states none."""
        return self.problem.reference()

    @cached_property
    def computed_reference(self) -> Reference | None:
        """The motion computed by two formulations, independent of the problem's own; None if not computable."""
        p = self.problem
        end = p.t_end if self.reference is None else min(p.t_end, self.reference.horizon)
        known = is_computable(p.system) and not p.literal_start
        return compute_reference(dataclasses.replace(p, t_end=end)) if known else None

    @cached_property
    def best_reference(self) -> Reference | None:
        """The problem's own exact motion, else the computed one; None if there is neither."""
        return self.reference if self.reference is not None else self.computed_reference

    @cached_property
    def t(self) -> np.ndarray:
        """The sample times [s] within the horizon of the best reference."""
        assert self.best_reference is not None
        return np.linspace(0.0, min(self.problem.t_end, self.best_reference.horizon), SAMPLES)

    def describe_span(self, end: float) -> str:
        """Return ``compared to 58.8 of 2000 s`` if ``end`` [s] is before the problem's own end, else an empty text."""
        return describe_span(end, self.problem.t_end)

    @cached_property
    def best_states(self) -> States:
        """The states of the best reference at the sample times ``t``."""
        assert self.best_reference is not None
        return self.best_reference.states(self.t)

    @cached_property
    def stated_error(self) -> np.ndarray:
        """The error that the best reference states at the sample times ``t`` [m]."""
        assert self.best_reference is not None
        return np.asarray(self.best_reference.error(self.t), dtype=float)

    @property
    def largest_error(self) -> float:
        """The largest stated error [m]; 0 where stated errors are not finite, which has a finding of its own."""
        own = self.stated_error
        return float(np.max(own)) if own.shape == self.t.shape and np.all(np.isfinite(own)) else 0.0

    @cached_property
    def rate(self) -> float:
        """The fastest rate at which poses change [rad/s].

        It is the largest angular velocity or, for bodies that turn little, such as a point mass on a link, the largest
        speed over the length of the motion; one over the time of the motion is added.
        """
        crossing = float(np.max(np.linalg.norm(self.best_states.v, axis=-1))) / self.size.length
        return 1.0 / max(self.t[-1], 1e-9) + max(float(np.max(np.abs(self.best_states.Omega))), crossing)

    @property
    def law_tolerance(self) -> float:
        """The tolerance on laws of an exact motion with this largest stated error, as a fraction of their scales."""
        return compute_law_tolerance(self.largest_error / self.size.length)

    def find_derivative_tolerance(self, step: float) -> float:
        """Return the relative tolerance on derivatives that are computed by differences over steps of ``step`` [s]."""
        return compute_derivative_tolerance(self.largest_error / self.size.length, step * self.rate)


def check_documentation(s: Subject) -> Finding:
    """Check that the problem has a docstring, a meaning for each parameter of its own, and a source.

    It must also bear the name under which it is registered.
    """
    entry = registry.problems()[s.name]
    own = {k: p for k, (_, p) in entry.parameters.items() if k not in registry.COMMON_PARAMETERS}
    missing = [] if entry.doc.strip() else ["the docstring of its function"]
    missing += [f"the meaning of {k}" for k, p in own.items() if not p.doc.strip()]
    missing += [what for what in ("source", "name") if not getattr(s.problem, what).strip()]
    named = s.problem.name == s.name
    words = ", ".join(missing) if missing or named else f"it calls itself {s.problem.name!r}"
    return judge_value(len(missing), "texts missing", most=0, words=words, good=named)


def check_initial_state(s: Subject) -> Finding:
    """Check that phi and phi_dot vanish at the start, by the same check as solvers make before the first step.

    The finding also states the number of constraint rows, their rank and the degrees of freedom.
    """
    made = registry.problems()[s.name].make()
    try:
        check_start(made.system, made.initial)
        words, good = _count_freedom(made), True
    except InconsistentStart as error:
        words, good = str(error), False
    one = States.one(made.initial)
    off = [motion.constraint(made.system, one), motion.constraint_rate(made.system, one)]
    gap = max(float(np.max(np.abs(a), initial=0.0)) for a in off)
    return judge_value(gap, "m or m/s", most=START_TOLERANCE, words=words, good=good)


def _count_freedom(made: Problem) -> str:
    """Describe the constraint rows at the start, in words: their number, rank, and the degrees of freedom.

    Joints with redundant rows are named. The rank is that of the rows scaled to unit length.
    """
    system = made.system
    size = np.linalg.svd(_normalise_rows(system, made.initial), compute_uv=False)
    rank = int(np.sum(size > RANK * np.max(size, initial=0.0)))
    words = f"{system.nrows} rows of rank {rank}: {6 * system.nb - rank} degrees of freedom at the start"
    if rank == system.nrows:
        return words
    names = [name_joint(system, k) for k in find_redundant_joints(system, made.initial)]
    return f"{words}; {system.nrows - rank} rows fewer in {', '.join(names)} would do"


def find_redundant_joints(system: MultibodySystem, state: State) -> list[int]:
    """Return the indices of joints without which the constraint rows are independent, as few as a greedy search finds.

    Joints are taken in the order of their numbers of rows, the fewest first, and each is kept if its rows are
    independent of those kept before. The others are returned.
    """
    A = _normalise_rows(system, state)
    rows = [np.arange(system.row_start[k], system.row_start[k + 1]) for k in range(system.nj)]
    kept: list[int] = []
    for k in sorted(range(system.nj), key=lambda k: len(rows[k])):
        both = A[np.concatenate([rows[j] for j in (*kept, k)])]
        size = np.linalg.svd(both, compute_uv=False)
        if len(both) <= len(A.T) and size[-1] > RANK * size[0]:
            kept.append(k)
    return [k for k in range(system.nj) if k not in kept]


def _normalise_rows(system: MultibodySystem, state: State) -> Float[np.ndarray, "nrows 6*nb"]:
    """Return the constraint Jacobian with rows of unit length; rows of zeros stay."""
    A = constraint_jacobian(system, state).toarray()
    length = np.linalg.norm(A, axis=1, keepdims=True)
    return A / np.where(length > 0.0, length, 1.0)


def check_times(s: Subject) -> Finding:
    """Check that 0 < dt <= t_end [s], both finite."""
    p = s.problem
    good = all(math.isfinite(x) and x > 0.0 for x in (p.t_end, p.dt))
    return judge_value(p.t_end / p.dt if good else math.nan, "steps", 1.0, words=f"t_end = {p.t_end}, dt = {p.dt}")


def check_energy_scale(s: Subject) -> Finding:
    """Check that T + V of the start and the scale of energy [J] are finite, the scale above zero."""
    E = float(motion.energy(s.problem.system, States.one(s.problem.initial))[0])
    good = math.isfinite(E) and math.isfinite(s.size.energy) and s.size.energy > 0.0
    return judge_value(s.size.energy, "J", words=f"T + V = {E:.6g} J at the start", good=good)


def check_scalars(s: Subject) -> Finding:
    """Check that observables and invariants give one finite number per time, equal for equal states.

    Their names must be different identifiers, and their units texts. Left open if there are none.
    """
    p = s.problem
    scalars: list[Observable | Invariant] = [*p.observables, *p.invariants]
    for names in ([m.name for m in p.observables], [m.name for m in p.invariants]):
        if len(set(names)) < len(names) or not all(n.isidentifier() for n in names):
            return make_failure(
                f"names must be different words of letters, digits and _ (got {', '.join(map(repr, names))})"
            )
    one = p.home(States.one(p.initial))
    many = States(*(np.repeat(getattr(one, f), 3, axis=0) for f in FIELDS))
    for m in scalars:
        if not isinstance(m.unit, str):
            return make_failure(f"{m.name}: unit must be text (got {m.unit!r})")
        values = np.asarray(m.of(many))
        if values.shape != (3,) or not np.all(np.isfinite(values)) or np.ptp(values) > 0.0:
            expected = "of three equal states expected three equal finite numbers"
            return make_failure(f"{m.name}: {expected} (got {values.tolist()})")
    return judge_value(len(scalars), "tried") if scalars else leave_open("there are none")


def check_repeatability(s: Subject) -> Finding:
    """Check that start, masses and reference agree bit for bit with those of the problem made a second time."""
    again = registry.make_problem(s.name)
    reference = again.reference()
    if (reference is None) != (s.reference is None):
        return make_failure("the reference comes and goes")
    pairs = {f"initial {f}": (getattr(s.problem.initial, f), getattr(again.initial, f)) for f in FIELDS}
    pairs["masses"] = s.problem.system.mass, again.system.mass
    if reference is not None:
        pairs["the reference"] = s.best_states.r, reference.states(s.t).r
    return judge_largest_error(
        {name: (float(np.max(np.abs(a - b), initial=0.0)), "") for name, (a, b) in pairs.items()}, 0.0
    )


def check_turned(s: Subject) -> Finding:
    """Check that observables of the start agree to ``TURNED`` if the problem is rotated by a fixed rotation vector."""
    turned = registry.make_problem(s.name, {"rotation": (0.3, -0.2, 0.5)})  # checks the rotated start
    here = s.problem.observe(States.one(s.problem.initial))
    there = turned.observe(States.one(turned.initial))
    found = {}
    for name in here:
        a, b = (float(np.ravel(values[name])[0]) for values in (here, there))
        words = f"is {a:.6g} at the start, {b:.6g} when everything is turned"
        found[name] = abs(a - b) / (1.0 + s.size.length + abs(a)), words
    return judge_largest_error(found, TURNED)


def check_stated_error(s: Subject) -> Finding:
    """Check that the reference states a finite error >= 0 [m] at each time, with its route and a horizon above zero.

    The error must be at most ``JUDGED`` of the length scale.
    """
    assert s.reference is not None
    own = s.stated_error
    if own.shape != s.t.shape or not np.all(np.isfinite(own)) or np.any(own < 0.0):
        return make_failure(
            f"error(t) must be {len(s.t)} finite numbers >= 0 for as many times (got {own.tolist()[:3]} ...)"
        )
    good = bool(s.reference.route.strip()) and s.reference.horizon > 0.0
    words = f"route {s.reference.route!r}, horizon {s.reference.horizon:g} of {s.problem.t_end:g} s"
    return judge_value(float(own.max()), "m", most=JUDGED * s.size.length, words=words, good=good)


def check_reference_start(s: Subject) -> Finding:
    """Check that the reference begins with r, R, v (space) and Omega (body) of the start."""
    p, rate, found = s.problem, s.rate, {}
    units = {"r": s.size.length, "R": 1.0, "v": s.size.length * rate, "Omega": rate}
    for name, unit in units.items():
        gap = float(np.max(np.abs(getattr(s.best_states[0], name) - getattr(p.initial, name)), initial=0.0))
        found[name] = gap / unit, f"differs by {gap:.3g} at t = 0"
    return judge_largest_error(found, s.law_tolerance)


def check_computed_reference(s: Subject) -> Finding:
    """Check that the problem's own reference agrees with the computed one to the stated errors of both.

    Their distance is that of positions, or the angle times the radius of gyration. Left open if none can be computed.
    """
    if s.computed_reference is None:
        return leave_open("none can be computed for this system")
    t = s.t[s.t <= s.computed_reference.horizon]
    there = s.computed_reference.states(t)
    gap = measure_distance(s.best_states.at(slice(len(t))), there, s.problem.system.gyration)
    beyond = np.maximum(gap - s.stated_error[: len(t)] - s.computed_reference.error(t), 0.0)
    words = ", ".join(filter(None, (f"r and R are {np.max(gap):.3g} m apart", s.describe_span(t[-1]))))
    return judge_largest_error({"": (float(np.max(beyond)) / s.size.length, words)}, SMALL)


def check_joints(s: Subject) -> Finding:
    """Check that phi [m] and R^T R - 1 vanish along the reference, to its stated error."""
    phi = float(np.max(np.abs(motion.constraint(s.problem.system, s.best_states)), initial=0.0))
    defect = float(np.max(so3.orthogonality_defect(s.best_states.R)))
    joints = phi / max(s.size.length, 1.0), f"reaches {phi:.3g}"
    return judge_largest_error({"|phi|": joints, "|R^T R - 1|": (defect, f"reaches {defect:.3g}")}, s.law_tolerance)


def check_energy(s: Subject) -> Finding:
    """Check that T + V [J] is constant along the reference, unless a damper, a load or a drive acts."""
    if not s.problem.system.is_conservative:
        return leave_open("a damper, a load or a drive acts")
    spread = float(np.ptp(motion.energy(s.problem.system, s.best_states)))
    return judge_largest_error(
        {"T + V": (spread / s.size.energy, f"changes by {spread:.3g} J, of {s.size.energy:.3g} J")}, s.law_tolerance
    )


def check_invariants(s: Subject) -> Finding:
    """Check that each invariant is constant along the best reference, relative to the scale of its unit.

    A unit without a scale has the largest value of the invariant instead. Left open without any reference.
    """
    if s.best_reference is None:
        return leave_open("no reference, and none can be computed")
    at_home, found = s.problem.home(s.best_states), {}
    for kept in s.problem.invariants:
        values = np.asarray(kept.of(at_home))
        scale = s.size.of_unit(kept.unit)
        scale = scale if math.isfinite(scale) else max(float(np.max(np.abs(values))), 1e-3)
        spread = float(np.ptp(values))
        words = (f"changes by {spread:.3g} {kept.unit}, of {scale:.3g}", s.describe_span(s.t[-1]))
        found[kept.name] = spread / scale, ", ".join(filter(None, words))
    return judge_largest_error(found, PRODUCTS * s.law_tolerance)


def _sample_around(s: Subject) -> tuple[list[States], float]:
    """Return the reference at seven equidistant times around some of the sample times, and their spacing [s].

    The seven times are the nodes of the difference formula ``DIFFERENCE``; the fourth is the sample time. Each of the
    seven states has an entry per sample time.
    """
    assert s.reference is not None
    step = min(1e-2 / s.rate, s.t[-1] / 100.0)
    t = s.t[3:-3:4]
    return [s.reference.states(t + k * step) for k in range(-3, 4)], step


def check_rates(s: Subject) -> Finding:
    """Check dr/dt = v (space) and dR/dt = R hat(Omega) (body), by differences of sixth order."""
    near, step = _sample_around(s)
    r_dot, R_dot = (np.tensordot(DIFFERENCE, [getattr(x, f) for x in near], 1) / step for f in ("r", "R"))
    here = near[3]
    v = float(np.max(np.abs(r_dot - here.v)))
    Omega = float(np.max(np.abs(R_dot - here.R @ so3.hat(here.Omega))))
    found = {
        "dr/dt - v": (v / s.size.length / s.rate, f"reaches {v:.3g} m/s"),
        "dR/dt - R hat(Omega)": (Omega / s.rate, f"reaches {Omega:.3g} 1/s"),
    }
    return judge_largest_error(found, s.find_derivative_tolerance(step))


def check_newton_euler(s: Subject) -> Finding:
    """Check that the reference obeys Newton's and Euler's equations: the loads that are left over are joint forces.

    These are m dv/dt and J dOmega/dt + Omega x J Omega, minus applied loads, and must be in the range of A^T.
    """
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
    return judge_largest_error(found, PRODUCTS * s.find_derivative_tolerance(step))
