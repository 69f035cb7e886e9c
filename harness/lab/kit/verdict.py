"""Pass or fail an engine by two runs, at a step and at half of it, against the exact motion.

The allowed deviation from a law at time t is the sum of three parts::

    rounding   u (3 + n) growth(t): u = 2^-24 or 2^-53 of all numbers given (three standard deviations), and of the
               state once in each of n steps, carried along the exact motion (module ``conditioning``)
    step       2 max |x_dt - x_dt/2| / (2^p - 1): Richardson's estimate for order p, doubled for the next term
    reference  its stated error, and the rounding of this evaluation in float64

An error that does not fall with the step as the order promises exceeds this sum. Beyond that, the motion at the half
step must be one that the referee calls a success. The limits are those of ``judge.law`` and ``judge.order``.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from ...judge.distance import find_first_time, find_inaccuracy
from ...judge.law import DEVIATIONS, PRECISIONS, compute_start_tolerance, estimate_relative_rounding, list_broken_laws
from ...judge.metrics.measure import measure
from ...judge.metrics.summary import make_columns
from ...judge.order import bound_fine_error
from ...mechanics.state import States
from ...mechanics.types import Law, Problem, Reason, Status, Trajectory
from ...reference.computation import find_reference
from ...results.findings import Finding, judge_value
from .cases import make_case
from .conditioning import evaluate_laws, measure_growth
from .model import Model

STEP = 2e-3  # [s]
# (r, q, v, omega) at the start and after each step, as ``check`` describes them
Motion = Iterable[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]
WORDS = {
    Law.MOTION: ("error", "m"),
    Law.VELOCITY: ("error of velocities", "m/s"),
    Law.CONSTRAINT: ("closure", "m"),
    Law.CONSTRAINT_RATE: ("closure of velocities", "m/s"),
    Law.ENERGY: ("energy", "J"),
    Law.FINITE: ("finite", ""),
    Law.START: ("start", ""),
}


class EngineFailure(AssertionError):
    """Signal that the motion of an engine is not that of the case; the message has a line for each violated law."""


def check(
    case: str, motion: Callable[[Model], Motion], *, order: float = 1.0, precision: str = "float64", dt: float = STEP
) -> list[Finding]:
    """Step an engine's model of ``case`` at ``dt`` [s] and ``dt / 2``; raise EngineFailure where its motion is wrong.

    ``motion(model)`` yields (r, q, v, omega) of all bodies at the start and after each step of ``model.dt``: centres of
    mass (nb, 3), quaternions (w, x, y, z) or matrices to space, velocities of the centres, angular velocities, all in
    the space frame. ``order`` is the order that the engine claims, ``precision`` that of its numbers. Return a finding
    on each law: its largest value divided by its allowance. Raise ValueError for an unknown case, order or precision.
    """
    if precision not in PRECISIONS:
        raise ValueError(f"precision must be float32 or float64 (got {precision!r})")
    if not (order >= 1.0 and math.isfinite(order)):
        raise ValueError(f"order must be a number >= 1 (got {order!r})")
    problem = make_case(case)
    steps = max(2, round(problem.t_end / dt))
    coarse, fine = (_run_engine(case, problem, motion, k * steps, PRECISIONS[precision]) for k in (1, 2))
    found, broken = _compare_laws(case, problem, coarse, fine, order, PRECISIONS[precision])
    if lines := [_describe_reason(case, r) for r in (*broken, *_judge_motion(problem, fine, {r.law for r in broken}))]:
        raise EngineFailure("\n".join(lines))
    return found


def estimate_rounding(case: str, precision: str, dt: float = STEP) -> float:
    """Return the error at the end [m] that rounding alone may leave at half the step ``dt`` [s]."""
    steps = 2 * max(2, round(make_case(case).t_end / dt))
    _, growth = _measure_growth_once(case)
    return PRECISIONS[precision] * (DEVIATIONS + steps) * float(growth[Law.MOTION, ""][-1])


def _run_engine(case: str, problem: Problem, motion: Callable[[Model], Motion], steps: int, unit: float) -> States:
    """Run the engine for ``steps`` steps and return its motion.

    Raise EngineFailure where it ends early, has wrong shapes, is not finite, or starts elsewhere than the case;
    ``unit`` is the rounding unit of the engine's numbers.
    """
    t = np.linspace(0.0, problem.t_end, steps + 1)
    rows = [
        tuple(np.array(part, dtype=float) for part in row)
        for row in itertools.islice(motion(Model(case, problem, problem.t_end / steps)), steps + 1)
    ]
    nb = problem.system.nb
    if len(rows) < steps + 1:
        raise EngineFailure(f"{case}: steps: expected the start and {steps} steps, got {len(rows)} rows")
    shapes = [a.shape for a in rows[0]]
    if (
        len(shapes) != 4
        or shapes[0] != (nb, 3)
        or shapes[1] not in ((nb, 4), (nb, 3, 3))
        or shapes[2:] != [(nb, 3)] * 2
    ):
        expected = f"({nb}, 3), ({nb}, 4) or ({nb}, 3, 3), ({nb}, 3), ({nb}, 3)"
        raise EngineFailure(f"{case}: shapes of r, q, v, omega: expected {expected}, got {shapes}")
    r, q, v, omega = (np.stack(part) for part in zip(*rows, strict=True))
    finite = np.isfinite(np.concatenate([a.reshape(len(t), -1) for a in (r, q, v, omega)], axis=1)).all(axis=1)
    if not np.all(finite):
        raise EngineFailure(_describe_reason(case, Reason(Law.FINITE, time_s=float(t[np.argmin(finite)]))))
    R = (
        q
        if q.ndim == 4
        else Rotation.from_quat(q.reshape(-1, 4), scalar_first=True).as_matrix().reshape(len(t), nb, 3, 3)
    )
    found = States(r, R, v, np.einsum("tbji,tbj->tbi", R, omega), t)
    start = problem.initial
    for name in ("r", "R", "v", "Omega"):
        exact, given = getattr(start, name), getattr(found, name)[0]
        off, allowed = float(np.max(np.abs(given - exact))), compute_start_tolerance(unit, float(np.max(np.abs(exact))))
        if off > allowed:
            raise EngineFailure(f"{case}: start: {name} is off by {off:.3g}, allowed {allowed:.2g}")
    return found


def _compare_laws(
    case: str, problem: Problem, coarse: States, fine: States, order: float, unit: float
) -> tuple[list[Finding], list[Reason]]:
    """Return for each law the finding on its largest value divided by the allowance, and the laws that are broken.

    ``coarse`` and ``fine`` are the motions at the step and at half of it, ``order`` is the engine's, ``unit`` the
    rounding unit of its numbers.
    """
    t, steps = coarse.times, len(fine) - 1
    at_coarse = fine.at(slice(None, None, 2))
    exact, stated_error = _evaluate_reference(case, steps // 2)
    laws = {name: evaluate_laws(problem, s, exact) for name, s in (("coarse", coarse), ("fine", at_coarse))}
    between = evaluate_laws(problem, coarse, at_coarse)
    grown, growth = _measure_growth_once(case)
    found, broken = [], []
    for key, series in laws["fine"].items():
        law, name = key
        vector = law in (Law.MOTION, Law.VELOCITY)
        halved = between[key] if vector else laws["coarse"][key] - series
        # the maximum over all times: transients last some steps, not a time
        step = bound_fine_error(float(np.max(np.abs(halved))), order)
        rounding = estimate_relative_rounding(unit, np.linspace(0.0, steps, len(t))) * np.interp(t, grown, growth[key])
        allowed = step + rounding + stated_error * growth[key][-1] / growth[Law.MOTION, ""][0]
        ratio = np.abs(series) / allowed
        worst = int(np.argmax(ratio))
        words, unit_ = WORDS.get(law) or (name, next(i.unit for i in problem.invariants if i.name == name))
        found.append(judge_value(float(ratio[worst]), "of what is allowed", most=1.0, quantity=words))
        if not found[-1].holds:
            first = find_first_time(t, ratio > 1.0)
            broken.append(Reason(law, float(abs(series[worst])), float(allowed[worst]), unit_, first, name))
    return found, broken


@cache
def _measure_growth_once(case: str) -> tuple[np.ndarray, dict]:
    """Return ``measure_growth`` of a case: times [s] and the growth of each law's quantity; computed once."""
    return measure_growth(make_case(case))


@cache
def _evaluate_reference(case: str, steps: int) -> tuple[States, float]:
    """Return the exact motion at equal steps and its largest stated error [m].

    Raise ValueError if the case has no reference up to its end.
    """
    problem = make_case(case)
    reference = find_reference(problem)
    if reference is None or reference.horizon < problem.t_end * (1.0 - 1e-9):
        raise ValueError(f"case {case} has no reference up to {problem.t_end:g} s")
    t = np.linspace(0.0, problem.t_end, steps + 1)
    return reference.states(t).with_times(t), float(np.max(reference.error(t)))


def _judge_motion(problem: Problem, s: States, known: set[Law]) -> Iterator[Reason]:
    """Yield the reasons why the referee would not call the motion ``s`` a success, except for laws in ``known``.

    The law of truncation is left out: it compares differences over a step, which are below rounding.
    """
    start = problem.initial
    exact_start = {k: np.concatenate((getattr(start, k)[None], getattr(s, k)[1:])) for k in ("r", "R", "v", "Omega")}
    trajectory = Trajectory(s.times, States(**exact_start), Status.SUCCESS, "", {})
    m = measure(problem, trajectory)
    numbers = make_columns(problem, trajectory, m)
    for r in list_broken_laws(problem, trajectory, m, numbers) or find_inaccuracy(m, numbers):
        if r.law not in known and r.law is not Law.TRUNCATION:
            yield r


def _describe_reason(case: str, r: Reason) -> str:
    """Return a line such as ``top: energy: off by 172 J, allowed 1.7 J, first at t = 0.4 s``."""
    words = r.name or WORDS.get(r.law, (str(r.law), ""))[0]
    when = "" if math.isnan(r.time_s) else f", first at t = {r.time_s:.4g} s"
    if math.isnan(r.value):
        return f"{case}: {words}: expected finite numbers, got others{when}"
    unit = f" {r.unit}" if r.unit else ""
    return f"{case}: {words}: off by {r.value:.3g}{unit}, allowed {r.limit:.2g}{unit}{when}"
