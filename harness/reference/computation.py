"""Find the reference of any problem: its own exact motion, else one computed by two routes that share no equation.

Route 1 is Newton and Euler in quaternions by DOP853 (``newton_euler``), route 2 Lagrange in natural coordinates by
extrapolation (``directors``); where damping makes them stiff, both use collocation. They start at a wide tolerance. If
they do not agree to ``AGREED`` of the reach up to the end, they run again at the rounding floor; if that run does not
reach the end, the first one continues. The stated error is ten times the largest disagreement so far. A reference ends
where that error exceeds ``WORST`` of the reach, where a route fails (a singular passage), or where ``BUDGET`` is spent;
``ends`` says which.
"""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from types import FunctionType, ModuleType
from typing import get_args, get_type_hints

import numpy as np
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from ..mechanics import added_inertia, fixed_order, time_functions, user_forces
from ..mechanics.kept_code import UndigestibleValue, digest_callback
from ..mechanics.state import State, States
from ..mechanics.system import MultibodySystem
from ..mechanics.torsion import count_determined_rows, evaluate_torsion, rewind_springs
from ..mechanics.types import Problem, Reference
from . import orbit
from .collocation import Collocation, estimate_jacobian
from .director_rows import ROWS
from .directors import Directors
from .extrapolation import Rate, vectorize_rate
from .held import recall_value
from .moving_rows import ROW_FUNCTIONS
from .newton_euler import NewtonEuler
from .orbit import Orbit, Pair, Piece

WORST, AGREED = 1e-3, 1e-10  # stated errors as shares of the reach: the largest one; one that needs no second run
FAR = 1e-12  # stated error, as a share of the distance from the origin, that no tolerance can undercut: rounding
LEVELS = ((1e-11, 1e-10), (1e-13, 1e-13))  # tolerance of route 1, correction of route 2
BUDGET = 4.0  # [s] by the cost model, not by the clock: the horizon must not depend on the machine and its load
FEWEST = 300  # fewest steps of route 2 that any budget pays for
LARGEST = 40.0  # [s] by the cost model: systems for which ``FEWEST`` steps of route 2 take longer get no reference
DAMPED = 10.0  # evaluations of either explicit route over the time 1 / |eigenvalue|, measured on the governor
INVERSE = 1.5e-9  # [s] per n^3, for the matrices of a step by collocation
# steps of route 2 between two projections. Half and twice state 0.4 to 1 times the errors on a spring pendulum, a
# damped linkage and a governor, at the same cost.
CHUNK = 16
WINDING = 2.0  # [rad] that a spring beyond half a turn may wind over a chunk, at its rate at the chunk's start
TRIES = 12  # most attempts, each shorter, at a chunk in which springs wind more than half a turn
REFERENCE = "reference"  # key of a held problem's reference
SPENT = "its budget of time is spent"
PARTED = "from there on its routes differ by more than a thousandth of the reach, as of chaotic motions"
# as CHUNK, where rows are redundant: the rows in use, chosen at its start, may become dependent. On Bricard's linkage
# half states an error of 3e-13 in place of 2e-12 m; twice needs a second run.
SHORT = 4


@dataclass(frozen=True)
class ComputedReference:
    """A reference computed by two routes: its motion is that of route 1, its stated error follows from route 2."""

    orbit: Orbit
    first: NewtonEuler

    @property
    def route(self) -> str:
        """The two routes and their methods, in words."""
        methods = ("Radau IIA, 7 nodes", "Radau IIA, 9 nodes") if self.orbit.stiff else ("DOP853", "extrapolation")
        return "computed: Newton-Euler ({}), agreeing with natural coordinates ({})".format(*methods)

    @property
    def ends(self) -> str:
        """The reason why the reference ends before its problem does; empty if it does not."""
        return self.orbit.ends

    @property
    def horizon(self) -> float:
        """The time [s] up to which the motion is known and its error stated."""
        return self.orbit.horizon

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        """Return the motion at ``t`` [s], up to the horizon."""
        return self.first.states(self.orbit(t)).with_times(np.asarray(t, dtype=float))

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Return a bound [m] on the position error of any body, and on rotation errors times radii of gyration."""
        return self.orbit.error(t)


def find_reference(problem: Problem) -> Reference | None:
    """Return a problem's exact motion, the closed form of a body on a hinge, or a motion computed or loaded from disk.

    None if the system is too large to compute one, if the computation fails, or for a literal start, which opens the
    joints.
    """
    return recall_value(problem, REFERENCE, lambda: _find_reference(problem))


def _find_reference(problem: Problem) -> Reference | None:
    """Return the reference of a problem from its own exact motion, a closed form, the disk, or a computation."""
    exact = problem.reference()
    if exact is None and not problem.literal_start:
        exact = _import_hinged().find_hinged_motion(problem.system, problem.initial, problem.t_end)
    known = exact is not None or problem.literal_start or not is_computable(problem.system)
    return exact if known else compute_reference(problem)


@cache
def _import_hinged() -> ModuleType:
    """Return the module with the closed form of a body on a hinge.

    It belongs to the problems and is imported by name.
    """
    return import_module("...problems.exact.hinged", __package__)


def explain_end(reference: Reference | None) -> list[str]:
    """Return a note, in a list, on when and why a reference ends before its problem does; empty if it does not."""
    ends = getattr(reference, "ends", "")
    return [f"reference ends at {reference.horizon:.4g} s: {ends}"] if reference is not None and ends else []


class Source(StrEnum):
    """The origin of a problem's reference."""

    OWN = "own"  # the problem's exact motion; it is missing for some starts, and then another source serves
    CERTIFIED = "certified"  # the problem's own integration by two routes, no formula; missing for some starts
    HINGED = "hinged"  # the closed form of one body on one fixed hinge
    COMPUTED = "computed"
    NONE = "none"  # too large, a start that opens its joints, or moving rows of a kind that the routes do not know


def describe_source(problem: Problem) -> Source:
    """Return the origin of a problem's reference, without computing anything."""
    if problem.literal_start:
        return Source.NONE
    if problem.reference_from is not None:
        return Source.CERTIFIED if _is_integrated(problem.reference_from) else Source.OWN
    if _import_hinged().is_hinged(problem.system):
        return Source.HINGED
    return Source.COMPUTED if is_computable(problem.system) else Source.NONE


def _is_integrated(reference_from: Callable[..., object]) -> bool:
    """Return whether the reference that ``reference_from`` returns is an integrated orbit and no formula.

    The annotated type of its result decides; nothing is computed.
    """
    function = reference_from.func if isinstance(reference_from, partial) else reference_from
    returned = get_type_hints(function).get("return") if isinstance(function, FunctionType) else None
    return any(getattr(k, "__annotations__", {}).get("orbit") is Orbit for k in (returned, *get_args(returned)))


def is_computable(system: MultibodySystem) -> bool:
    """Return whether a reference can be computed for a system: up to about 60 bodies.

    Both routes must support all its kinds of rows, and ``FEWEST`` steps of route 2 must cost less than ``LARGEST`` [s].
    """
    if not set(system.moving_rows().kind) <= ROW_FUNCTIONS.keys() & ROWS.keys():
        return False
    return _estimate_least_cost(system) < LARGEST


def _estimate_least_cost(system: MultibodySystem) -> float:
    """Return the CPU time [s] that ``FEWEST`` steps of route 2 take by the model of ``estimate_cost``.

    A step of extrapolation takes 72 evaluations.
    """
    return FEWEST * 72 * estimate_cost(system)[1]


def estimate_cost(system: MultibodySystem) -> tuple[float, float]:
    """Return the CPU times [s] of one evaluation of a state, by route 1 and by route 2, from a model.

    The model was fitted to systems of 1 to 55 bodies (docs/decisions); it depends on the system's size alone.
    """
    n, nb = float(system.nrows), float(system.nb)
    laws = 1e-4 * len(system.user_i)  # evaluated one by one, in Python
    redundant = n > 6.0 * nb - 1.0  # decided before any state is known: chains of the catalogue have fewer rows
    first = 5e-5 + 7e-8 * nb * n + 3e-11 * n**3
    return first + laws, 2.5e-5 + 1.2e-7 * nb * n + (2.5e-10 if redundant else 5e-11) * n**3 + 0.25 * laws


def compute_reference(problem: Problem) -> ComputedReference | None:
    """Compute the reference by two routes and store it on disk, or load it from there if it was computed before.

    The problem's own exact motion, if there is one, is not used. None if not even a first chunk succeeds.
    """
    found = orbit.load_or_compute(
        _digest_problem(problem), lambda: _find_agreement(problem.system, problem.initial, problem.t_end)
    )
    return None if found is None else ComputedReference(found, NewtonEuler(problem.system))


def _digest_problem(problem: Problem) -> str | None:
    """Return the digest by which a motion is stored: of the system, start, end time, budget and code of the routes.

    None if a user's force law depends on an object without a digest.
    """
    digest = hashlib.sha256(_read_route_code())
    digest.update(repr((problem.t_end, BUDGET)).encode())
    s, start = problem.system, problem.initial
    arrays = [v for v in vars(s).values() if isinstance(v, np.ndarray) and v.dtype != object]
    laws = [np.append(law.frame, law.units) for law in s.user_law]
    for a in (*arrays, start.r, start.R, start.v, start.Omega, np.array(start.t), *laws):
        digest.update(f"{a.shape}{a.dtype}".encode() + np.ascontiguousarray(a).tobytes())
    try:
        digest.update("".join(digest_callback(law.function, law.bodies) for law in s.user_law).encode())
    except UndigestibleValue:
        return None
    return digest.hexdigest()


@cache
def _read_route_code() -> bytes:
    """Return the source text of this folder and of the other modules that the routes use, joined."""
    here = sorted(Path(__file__).parent.glob("*.py"))
    shared = [Path(str(m.__file__)) for m in (added_inertia, fixed_order, time_functions, user_forces)]
    return b"".join(f.read_bytes() for f in (*here, *shared))


@dataclass
class _Motion:
    """The integration of a motion by both routes, chunk by chunk, within a budget of CPU time.

    ``reach`` [m] is the farthest that a body has moved so far: its C, or its rotation times its radius of gyration.
    """

    system: MultibodySystem
    start: State
    t_end: float
    left: float  # [s] left of the budget
    first: NewtonEuler = field(init=False)
    second: Directors = field(init=False)
    given: MultibodySystem = field(init=False)  # the system that both routes are set up for
    frequency: float = field(init=False)  # [rad/s] of drives and loads
    reach: float = 0.0
    stiff: bool = False  # whether both routes use collocation
    why: str = ""  # why the integration ended early, in words

    def __post_init__(self) -> None:
        """Set up both routes, and the lengths and frequency on which their tolerances and first steps depend."""
        self.given = replace(self.system)  # a copy, for which no routes are set up yet
        self._set_up_routes(self.system)
        self.radius = self.system.gyration
        sines = [a[a[:, 4] != 0.0, 5] for a in (self.system.joint_motion, self.system.load_factor)]
        self.frequency = float(np.max(np.abs(np.concatenate(sines)), initial=0.0))
        self.size = float(max(np.max(self.radius), np.max(np.abs(self.system.joint_s_i), initial=0.0)))

    def integrate_chunks(self, tolerance: float, correction: float) -> Iterator[Piece]:
        """Integrate by both routes from the start to t_end, and yield chunks of about ``CHUNK`` steps of route 2.

        After each, both states are projected onto the constraints. ``tolerance`` is that of route 1, ``correction``
        that of route 2, relative to the scales of the states. If a route fails or the budget is spent, ``why`` is set
        and the chunks end. A chunk in which a spring winds more than half a turn is repeated with a rewound spring.
        """
        try:
            self._set_up_routes(self.system)
            y, z = self.first.project_state(self.first.pack_state(self.start)), self.second.pack_state(self.start)
            first, second, pair = self._make_pair(y, z)
            begin, speed, turn, self.reach = self.first.states(y[None]), 0.0, 0.0, 0.0
            t, span, tries = 0.0, self.t_end, 0
            self.stiff = self.is_stiff(y)
            routes = self._make_collocations(first, second, len(y) + len(z)) if self.stiff else None
            while t < self.t_end:
                most = CHUNK if len(self.first.rows) == self.first.nrows else SHORT
                speed, turn = self._update_speeds(y, speed, turn)
                span = min(self.t_end - t, 4.0 * span if t else 0.25 / turn * 0.5**tries)
                length = max(self.size, 0.1 * float(np.max(np.abs(y[: 3 * self.system.nb]))))
                scales = self.first.units(length, speed, turn), self.second.units(length, speed, turn)
                span, left = min(span, self._estimate_law_time(y)), self.left
                try:
                    piece = self._advance_chunk(pair, routes, (t, y, z), span, (tolerance, correction), scales, most)
                except ArithmeticError:
                    if self.left < 0.0 or tries == TRIES or not np.any(self.given.torsion_k):
                        raise
                    piece = None
                # a spring winds on: repeat with a law about its present angle
                if piece is None or not self._stays_within_laws(piece):
                    tries, self.left = tries + 1, left  # failed tries, which are few, are not charged to the budget
                    span *= 0.25 * 0.5 ** (tries - 1)  # the next chunk tries four times this
                    self._set_up_routes(rewind_springs(self.given, self.first.states(y[None])[0]))
                    y, z = self.first.project_state(y), self.second.project_state(z)
                    first, second, pair = self._make_pair(y, z)
                    routes = self._make_collocations(first, second, len(y) + len(z)) if self.stiff else None
                    continue
                t, span, tries = piece.t, min(span, most / 4.0 * span / len(piece.nodes)), 0
                self.reach = max(self.reach, self._measure_distance(begin, self.first.states(piece.y[None])))
                yield piece
                y, z = self.first.project_state(piece.y), self.second.project_state(piece.z)
        except (ArithmeticError, np.linalg.LinAlgError, ValueError) as error:  # ValueError: LAPACK, SciPy on overflow
            self.why = SPENT if str(error) == SPENT else f"a route fails there ({str(error).rstrip('.').lower()})"

    def _advance_chunk(
        self,
        pair: Pair,
        routes: tuple[Collocation, Collocation] | None,
        at: tuple[float, np.ndarray, np.ndarray],
        span: float,
        tolerances: tuple[float, float],
        units: tuple[np.ndarray, np.ndarray],
        most: int,
    ) -> Piece:
        """Advance both routes by ``span`` [s] from ``at``, time and both states (t, y, z), and return the chunk.

        The collocations ``routes`` are used if given, else DOP853 and extrapolation. ``tolerances`` are those of
        route 1 and route 2, ``units`` the scales of y and z; the first step of route 2 is ``span / most``.
        """
        tolerance, correction = tolerances
        if routes:
            return orbit.advance_stiff(pair, routes, at, span, tolerance, tolerance, units)
        return orbit.advance_routes(pair, at, span, tolerance, correction, units, most)

    def _set_up_routes(self, given: MultibodySystem) -> None:
        """Set up and compile both routes for the system ``given``, unless they are set up for it already.

        Its torsional springs may be rewound, so that their laws hold about other angles than at the start.
        """
        if given is not self.given:
            self.given, self.first, self.second = given, NewtonEuler(given), Directors(given)
            self.first.compile()
            self.second.compile()

    def _make_pair(self, y: np.ndarray, z: np.ndarray) -> tuple[Rate, Rate, Pair]:
        """Return the rates of both routes, which charge the budget, and a ``Pair`` of them that starts at y, z."""
        c_first, c_second = estimate_cost(self.system)
        first, second = self._charge_budget(self.first.rate, c_first), self._charge_budget(self.second.rate, c_second)
        return first, second, Pair(first, second, y, z, self._measure_disagreement, self.second.choose_rows)

    def _estimate_law_time(self, y: np.ndarray) -> float:
        """Return the time [s] in which the fastest torsional spring turns by ``WINDING`` at its present rate.

        Infinite as long as no spring was rewound.
        """
        if self.given is self.system:
            return np.inf
        rate = np.max(np.abs(evaluate_torsion(self.given, self.first.states(y[None]))[1]), initial=0.0)
        return float(WINDING / rate) if rate > 0.0 else np.inf

    def _stays_within_laws(self, piece: Piece) -> bool:
        """Return whether all torsional springs stay within half a turn of their laws' reference angles over a chunk."""
        if not np.any(self.given.torsion_k):
            return True
        y, t = np.array([*(s[1] for s in piece.steps), piece.y]), np.array([*(s[0] for s in piece.steps), piece.t])
        return count_determined_rows(self.given, t, self.first.states(y)) == len(t)

    def limit_error(self, fraction: float) -> float:
        """Return the limit [m] on the stated error: ``fraction`` times the reach so far.

        For stiff systems the fraction is always ``WORST``: their budget pays for one run only.
        """
        return (WORST if self.stiff else fraction) * self.reach

    def is_stiff(self, y: np.ndarray) -> bool:
        """Return whether damping keeps explicit steps so short that the budget cannot pay for them.

        The eigenvalues of route 1 at the start ``y`` decide. False without dampers and user forces.
        """
        s = self.system
        if not (np.any(s.spring_c) or np.any(s.torsion_c) or len(s.user_i)):
            return False
        J = estimate_jacobian(vectorize_rate(self.first.rate), y, self.first.units(self.size, 1.0, 1.0))
        fastest_decay = -float(np.min(np.linalg.eigvals(J).real))  # [1/s]
        evaluations = len(LEVELS) * DAMPED * fastest_decay * self.t_end  # of each route, in all runs
        cpu_time = evaluations * sum(estimate_cost(s))  # [s]
        return cpu_time > BUDGET

    def _make_collocations(self, first: Rate, second: Rate, n: int) -> tuple[Collocation, Collocation]:
        """Return the collocations of both routes from their rates, with 7 and 9 stages.

        Each step subtracts the cost of its matrices from the budget; ``n`` is the number of unknowns of both states.
        """

        def begin() -> None:
            """Subtract the cost of a step's matrices from the budget, and let route 2 choose its rows anew."""
            self.left -= INVERSE * n**3 / 8.0
            self.second.choose_rows()

        return Collocation(vectorize_rate(first), begin), Collocation(second, begin, s=9)  # other nodes, other errors

    def _charge_budget(self, rate: Rate, each: float) -> Rate:
        """Wrap ``rate`` so that each state evaluated charges ``each`` [s] to the budget; return the wrapped rate.

        It raises ArithmeticError if the budget is spent or a rate is not finite.
        """

        def charged_rate(y: np.ndarray) -> np.ndarray:
            """Return the rate, after subtracting its cost from the budget."""
            self.left -= each * (len(y) if y.ndim > 1 else 1)
            if self.left < 0.0:
                raise ArithmeticError(SPENT)
            with np.errstate(all="ignore"):
                out = rate(y)
            if not np.all(np.isfinite(out)):
                raise ArithmeticError("no finite rate")
            return out

        return charged_rate

    def _measure_disagreement(self, y: np.ndarray, z: np.ndarray) -> float:
        """Return the distance [m] between the states of both routes, or the largest |phi| of route 1 if that is larger.

        Redundant rows, which route 1 leaves out, are included in |phi|.
        """
        apart = self._measure_distance(self.first.states(y[None]), self.second.states(z[None]))
        return max(apart, self.first.measure_violation(y))

    def _measure_distance(self, a: States, b: States) -> float:
        """Return the largest distance [m] between the poses of a body in the states ``a`` and ``b``.

        The distance of two poses is that of C, or that by rotation if it is larger: a rotation by theta counts as
        2 sin(theta/2) times the radius of gyration.
        """
        turned = self.radius * np.linalg.norm(a.R - b.R, axis=(-2, -1)) / np.sqrt(2.0)
        return float(np.max(np.maximum(np.linalg.norm(a.r - b.r, axis=-1), turned)))

    def _update_speeds(self, y: np.ndarray, speed: float, turn: float) -> tuple[float, float]:
        """Return the largest ``speed`` [m/s] and angular velocity ``turn`` [rad/s] so far, as scales of the rates.

        Arguments are those before, and the present state ``y`` of route 1. Accelerations, the size of the system,
        t_end and the frequency of drives give lower bounds.
        """
        nb = self.system.nb
        v, a = y[7 * nb : -1], self.first.rate(y)[7 * nb : -1]
        speed = max(speed, float(np.max(np.abs(v[: 3 * nb]))), float(np.sqrt(np.max(np.abs(a[: 3 * nb])) * self.size)))
        speed = max(speed, self.size / self.t_end)
        turn = max(turn, float(np.max(np.abs(v[3 * nb :]))), float(np.sqrt(np.max(np.abs(a[3 * nb :])))))
        turn = max(turn, self.frequency)
        return speed, max(turn, speed / self.size)


@dataclass
class _Level:
    """The motion at one pair of tolerances, which can be continued after its result so far has been examined."""

    motion: _Motion
    tolerances: tuple[float, float]  # of route 1, and correction of route 2
    taken: list[Piece] = field(default_factory=list)  # chunks so far
    found: Orbit | None = None  # the orbit returned last

    def __post_init__(self) -> None:
        """Create the generator of chunks, which computes none yet."""
        self._pieces = self.motion.integrate_chunks(*self.tolerances)

    def extend_orbit(self, fraction: float) -> Orbit | None:
        """Continue until the error bound exceeds the given ``fraction`` of the reach, or to the end of the motion.

        Return, and keep as ``found``, the orbit up to where the bound exceeds ``WORST``. None if no chunk succeeds.
        """
        motion = self.motion
        with threadpool_limits(1):  # for matrices so small threads cost ten times what they save
            found = orbit.join_chunks(self._list_chunks(), partial(motion.limit_error, fraction))
        if found is None:
            return None
        until = found.cut_at_bound(WORST * motion.reach)
        why = "" if until.horizon == motion.t_end else PARTED if until.horizon < found.horizon else motion.why
        ends = why or ("" if until.horizon == motion.t_end else PARTED)
        self.found = replace(until, stiff=motion.stiff, ends=ends)
        return self.found

    def _list_chunks(self) -> Iterator[Piece]:
        """Yield the chunks taken so far, then new ones."""
        yield from tuple(self.taken)
        for piece in self._pieces:
            self.taken.append(piece)
            yield piece


def _find_agreement(system: MultibodySystem, start: State, t_end: float) -> Orbit | None:
    """Return the orbit of the first of ``LEVELS`` at which both routes agree to the end, else the longest one.

    The level of wide tolerances pauses where its bound exceeds ``AGREED`` of the reach. If that of narrow ones does not
    reach the end either, the wide one continues on a budget of its own, and serves ``beyond`` the narrow one. A level
    that its budget ended is not continued. None if no level advances at all.
    """
    left, best, levels = max(BUDGET, 2.0 * _estimate_least_cost(system)), None, list[_Level]()
    for tolerances, share in zip((*LEVELS, LEVELS[0]), (AGREED, WORST, WORST), strict=True):
        again = len(levels) == len(LEVELS)
        if again and (best is not None and best.horizon == t_end):
            break
        level = levels[0] if again else _Level(_Motion(system, start, t_end, left), tolerances)
        motion = level.motion
        motion.left = max(motion.left, BUDGET) if again else motion.left
        levels.append(level)
        found, left = level.extend_orbit(share), motion.left
        if found is None:
            continue
        if again and best is not None and best.horizon > 0.0:
            best = replace(best, beyond=found, ends=found.ends) if found.horizon > best.horizon else best
        elif best is None or (found.horizon, -found.bound[-1]) > (best.horizon, -best.bound[-1]):
            best = found
        enough = max(AGREED * motion.reach, FAR * float(np.max(np.abs(start.r), initial=0.0)))
        if found.horizon == t_end and (found.bound[-1] < enough or motion.stiff):
            break
    return best if best is not None and best.horizon > 0.0 else None
