"""The reference of any problem: its own exact motion, else one computed by two routes that share no equation.

Newton and Euler in quaternions by DOP853, Lagrange in natural coordinates by extrapolation (modules ``newton_euler``,
``directors``), where damping makes them stiff both by collocation. First at a wide tolerance; where they do not agree
to ``AGREED`` of the reach to the end, at the rounding floor. The stated error is ten times the largest disagreement so
far. The motion ends where that error passes ``WORST`` of the reach, where a route fails (a singular passage), or where
``BUDGET`` is spent.
"""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cache, partial
from pathlib import Path
from types import FunctionType
from typing import get_args, get_type_hints

import numpy as np
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from ..mechanics import added_inertia, fixed_order, time_functions, user_forces
from ..mechanics.kept_code import Unknown, digest_of
from ..mechanics.state import State, States
from ..mechanics.system import MultibodySystem
from ..mechanics.torsion import count_right, torsion, wind
from ..types import Problem, Reference
from . import orbit
from .collocation import Collocation, jacobian
from .director_rows import ROWS
from .directors import Directors
from .extrapolation import Rate, each
from .newton_euler import NewtonEuler
from .orbit import Orbit, Pair, Piece
from .pushes import PUSHES

WORST, AGREED = 1e-3, 1e-10  # of the reach
FAR = 1e-12  # of the distance from the origin, whose rounding no tolerance gets below
LEVELS = ((1e-11, 1e-10), (1e-13, 1e-13))  # tolerance of route 1, correction of route 2
BUDGET = 4.0  # [s] by the cost model, not by the clock: the horizon must not depend on the machine and its load
FEWEST = 300  # steps of route 2 that any budget pays, up to twice ``LARGEST``: of larger systems too little is known
LARGEST = 40.0  # [s] by the cost model, for route 2 alone
DAMPED = 10.0  # evaluations of either explicit route over the time 1 / |eigenvalue|, measured on the governor
INVERSE = 1.5e-9  # [s] for the matrices of a step by collocation, of n^3
CHUNK = 16  # steps of route 2 between two projections
WINDING = 2.0  # [rad] by which a spring that has left half a turn may wind over a chunk, at the rate of its start
TRIES = 12  # of a chunk whose step fails where springs wind by more than half a turn, each shorter than the last
SHORT = 4  # the same where rows are redundant: those in use, chosen there, may come to depend on each other


@dataclass(frozen=True)
class ComputedReference:
    """The motion by route 1, its error by route 2."""

    orbit: Orbit
    first: NewtonEuler

    @property
    def route(self) -> str:
        """Both routes with their methods."""
        methods = ("Radau IIA, 7 nodes", "Radau IIA, 9 nodes") if self.orbit.stiff else ("DOP853", "extrapolation")
        return "computed: Newton-Euler ({}), agreeing with natural coordinates ({})".format(*methods)

    @property
    def horizon(self) -> float:
        """Up to here the error is stated [s]."""
        return self.orbit.horizon

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        """The motion at ``t`` [s], up to the horizon."""
        return self.first.states(self.orbit(t)).with_times(np.asarray(t, dtype=float))

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Bound [m] on the position error of any body, and on angles times radii of gyration."""
        return self.orbit.error(t)


def reference_of(problem: Problem) -> Reference | None:
    """The problem's exact motion, else the computed one (from disk if known); None if too large or a literal start."""
    exact = problem.reference()
    known = exact is not None or problem.literal_start or not is_computable(problem.system)
    return exact if known else compute_reference(problem)


class Source(StrEnum):
    """Where the reference of a problem comes from."""

    OWN = "own"  # the problem's exact motion; None for some starts, then as if it had none
    CERTIFIED = "certified"  # no formula: the problem's own integration by two routes of its own; None for some starts
    COMPUTED = "computed"
    NONE = "none"  # too large, a start that opens its joints, or moving rows of a kind that the routes do not know


def source_of(problem: Problem) -> Source:
    """Without computing anything."""
    if problem.literal_start:
        return Source.NONE
    if problem.reference_from is not None:
        return Source.CERTIFIED if _is_integrated(problem.reference_from) else Source.OWN
    return Source.COMPUTED if is_computable(problem.system) else Source.NONE


def _is_integrated(reference_from: Callable[..., object]) -> bool:
    """Whether what it is annotated to return has its motion on an ``Orbit``."""
    function = reference_from.func if isinstance(reference_from, partial) else reference_from
    returned = get_type_hints(function).get("return") if isinstance(function, FunctionType) else None
    return any(getattr(k, "__annotations__", {}).get("orbit") is Orbit for k in (returned, *get_args(returned)))


def is_computable(system: MultibodySystem) -> bool:
    """Whether the routes have its rows, and ``FEWEST`` steps fit the budget: up to about 60 bodies."""
    if not set(system.moving_rows().kind) <= PUSHES.keys() & ROWS.keys():
        return False
    return _fewest(system) < LARGEST


def _fewest(system: MultibodySystem) -> float:
    """[s] that ``FEWEST`` steps take."""
    return FEWEST * 72 * cost(system)[1]


def cost(system: MultibodySystem) -> tuple[float, float]:
    """[s] of CPU for an evaluation of one state by either route, measured at 1 to 55 bodies (docs/decisions)."""
    n, nb = float(system.nrows), float(system.nb)
    laws = 1e-4 * len(system.user_i)  # taken one by one, in Python
    redundant = n > 6.0 * nb - 1.0  # to be known before any state is: chains of the catalogue have fewer rows
    first = 5e-5 + 7e-8 * nb * n + 3e-11 * n**3
    return first + laws, 2.5e-5 + 1.2e-7 * nb * n + (2.5e-10 if redundant else 5e-11) * n**3 + 0.25 * laws


def compute_reference(problem: Problem) -> ComputedReference | None:
    """The computed reference, whatever else is known of the motion; None if not even a first chunk succeeds."""
    found = orbit.load_or_compute(
        _key(problem), lambda: _find_agreement(problem.system, problem.initial, problem.t_end)
    )
    return None if found is None else ComputedReference(found, NewtonEuler(problem.system))


def _key(problem: Problem) -> str | None:
    """Digest of the system, the start, the time, and the code of this room and what its routes share: none is stale.

    None where a user's law depends on what no digest can be made of.
    """
    digest = hashlib.sha256(_code())
    digest.update(repr((problem.t_end, BUDGET)).encode())
    s, start = problem.system, problem.initial
    arrays = [v for v in vars(s).values() if isinstance(v, np.ndarray) and v.dtype != object]
    laws = [np.append(law.frame, law.units) for law in s.user_law]
    for a in (*arrays, start.r, start.R, start.v, start.Omega, np.array(start.t), *laws):
        digest.update(f"{a.shape}{a.dtype}".encode() + np.ascontiguousarray(a).tobytes())
    try:
        digest.update("".join(digest_of(law.function, law.bodies) for law in s.user_law).encode())
    except Unknown:
        return None
    return digest.hexdigest()


@cache
def _code() -> bytes:
    here = sorted(Path(__file__).parent.glob("*.py"))
    shared = [Path(str(m.__file__)) for m in (added_inertia, fixed_order, time_functions, user_forces)]
    return b"".join(f.read_bytes() for f in (*here, *shared))


@dataclass
class _Motion:
    """Both routes on their way, in pieces; ``reach`` [m] is how far any body went or turned so far."""

    system: MultibodySystem
    start: State
    t_end: float
    left: float  # [s] of the budget
    first: NewtonEuler = field(init=False)
    second: Directors = field(init=False)
    given: MultibodySystem = field(init=False)  # the system of both routes now
    frequency: float = field(init=False)  # [rad/s] of drives and loads
    reach: float = 0.0
    stiff: bool = False  # of the motion on its way

    def __post_init__(self) -> None:
        self.given = replace(self.system)  # none of which routes are made yet
        self._take(self.system)
        self.radius = self.system.gyration
        sines = [a[a[:, 4] != 0.0, 5] for a in (self.system.joint_motion, self.system.load_factor)]
        self.frequency = float(np.max(np.abs(np.concatenate(sines)), initial=0.0))
        self.size = float(max(np.max(self.radius), np.max(np.abs(self.system.joint_s_i), initial=0.0)))

    def pieces(self, tolerance: float, correction: float) -> Iterator[Piece]:
        """Chunks of about ``CHUNK`` steps, both states made consistent after each; ends where a route fails."""
        try:
            self._take(self.system)
            y, z = self.first.project_state(self.first.start(self.start)), self.second.start(self.start)
            first, second, pair = self._pair(y, z)
            begin, speed, turn, self.reach = self.first.states(y[None]), 0.0, 0.0, 0.0
            t, span, tries = 0.0, self.t_end, 0
            self.stiff = self.is_stiff(y)
            routes = self._collocations(first, second, len(y) + len(z)) if self.stiff else None
            while t < self.t_end:
                most = CHUNK if len(self.first.rows) == self.first.nrows else SHORT
                speed, turn = self._speeds(y, speed, turn)
                span = min(self.t_end - t, 4.0 * span if t else 0.25 / turn * 0.5**tries)
                where = max(self.size, 0.1 * float(np.max(np.abs(y[: 3 * self.system.nb]))))
                units = (where, speed, turn)
                both = self.first.units(*units), self.second.units(*units)
                span, left = min(span, self._whole_law(y)), self.left
                try:
                    piece = self._chunk(pair, routes, (t, y, z), span, (tolerance, correction), both, most)
                except ArithmeticError:
                    if self.left < 0.0 or tries == TRIES or not np.any(self.given.torsion_k):
                        raise
                    piece = None
                if piece is None or not self._holds(piece):  # a spring winds on: again, with a law about where it is
                    tries, self.left = tries + 1, left  # the budget is for the motion, and tries are few
                    span *= 0.25 * 0.5 ** (tries - 1)  # of which four times is tried
                    self._take(wind(self.given, self.first.states(y[None])[0]))
                    y, z = self.first.project_state(y), self.second.project_state(z)
                    first, second, pair = self._pair(y, z)
                    routes = self._collocations(first, second, len(y) + len(z)) if self.stiff else None
                    continue
                t, span, tries = piece.t, min(span, most / 4.0 * span / len(piece.nodes)), 0
                self.reach = max(self.reach, self._apart(begin, self.first.states(piece.y[None])))
                yield piece
                y, z = self.first.project_state(piece.y), self.second.project_state(piece.z)
        except (ArithmeticError, np.linalg.LinAlgError, ValueError):  # ValueError: LAPACK and SciPy on overflow
            return

    def _chunk(
        self, pair: Pair, routes: tuple[Collocation, Collocation] | None, at: tuple[float, np.ndarray, np.ndarray],
        span: float, tolerances: tuple[float, float], units: tuple[np.ndarray, np.ndarray], most: int,
    ) -> Piece:  # fmt: skip
        tolerance, correction = tolerances
        if routes:
            return orbit.stiff_chunk(pair, routes, at, span, tolerance, tolerance, units)
        return orbit.chunk(pair, at, span, tolerance, correction, units, most)

    def _take(self, given: MultibodySystem) -> None:
        """Both routes of a system; the springs of ``given`` may be wound otherwise than at the start."""
        if given is not self.given:
            self.given, self.first, self.second = given, NewtonEuler(given), Directors(given)
            self.first.compile()
            self.second.compile()

    def _pair(self, y: np.ndarray, z: np.ndarray) -> tuple[Rate, Rate, Pair]:
        c_first, c_second = cost(self.system)
        first, second = self._charge(self.first.rate, c_first), self._charge(self.second.rate, c_second)
        return first, second, Pair(first, second, y, z, self._disagreement, self.second.choose_rows)

    def _whole_law(self, y: np.ndarray) -> float:
        """[s] over which springs that wind stay near the angles of their laws; endless as long as none does."""
        if self.given is self.system:
            return np.inf
        rate = np.max(np.abs(torsion(self.given, self.first.states(y[None]))[1]), initial=0.0)
        return float(WINDING / rate) if rate > 0.0 else np.inf

    def _holds(self, piece: Piece) -> bool:
        """Whether no torsional spring leaves half a turn about the angle that its law is made for."""
        if not np.any(self.given.torsion_k):
            return True
        y, t = np.array([*(s[1] for s in piece.steps), piece.y]), np.array([*(s[0] for s in piece.steps), piece.t])
        return count_right(self.given, t, self.first.states(y)) == len(t)

    def share(self, of: float) -> float:
        """A share of the reach so far [m]; of stiff systems the largest, for one level costs them the budget."""
        return (WORST if self.stiff else of) * self.reach

    def is_stiff(self, y: np.ndarray) -> bool:
        """Whether damping keeps explicit steps so short that the budget does not pay them."""
        s = self.system
        if not (np.any(s.spring_c) or np.any(s.torsion_c) or len(s.user_i)):
            return False
        J = jacobian(each(self.first.rate), y, self.first.units(self.size, 1.0, 1.0))
        return len(LEVELS) * DAMPED * -float(np.min(np.linalg.eigvals(J).real)) * self.t_end * sum(cost(s)) > BUDGET

    def _collocations(self, first: Rate, second: Rate, n: int) -> tuple[Collocation, Collocation]:
        """Of both routes; ``n`` is their size together."""

        def begin() -> None:
            self.left -= INVERSE * n**3 / 8.0
            self.second.choose_rows()

        return Collocation(each(first), begin), Collocation(second, begin, s=9)  # other nodes, other errors

    def _charge(self, rate: Callable[[np.ndarray], np.ndarray], each: float) -> Callable[[np.ndarray], np.ndarray]:
        def charged_rate(y: np.ndarray) -> np.ndarray:
            self.left -= each * (len(y) if y.ndim > 1 else 1)
            if self.left < 0.0:
                raise ArithmeticError("the budget is spent")
            with np.errstate(all="ignore"):
                out = rate(y)
            if not np.all(np.isfinite(out)):
                raise ArithmeticError("no finite rate")
            return out

        return charged_rate

    def _disagreement(self, y: np.ndarray, z: np.ndarray) -> float:
        """[m], with the constraint rows that route 1 dropped."""
        apart = self._apart(self.first.states(y[None]), self.second.states(z[None]))
        return max(apart, self.first.violation(y))

    def _apart(self, a: States, b: States) -> float:
        turned = self.radius * np.linalg.norm(a.R - b.R, axis=(-2, -1)) / np.sqrt(2.0)
        return float(np.max(np.maximum(np.linalg.norm(a.r - b.r, axis=-1), turned)))

    def _speeds(self, y: np.ndarray, speed: float, turn: float) -> tuple[float, float]:
        """Largest speed [m/s] and rate [rad/s] so far, or those that the accelerations promise over the size."""
        nb = self.system.nb
        v, a = y[7 * nb : -1], self.first.rate(y)[7 * nb : -1]
        speed = max(speed, float(np.max(np.abs(v[: 3 * nb]))), float(np.sqrt(np.max(np.abs(a[: 3 * nb])) * self.size)))
        speed = max(speed, self.size / self.t_end)
        turn = max(turn, float(np.max(np.abs(v[3 * nb :]))), float(np.sqrt(np.max(np.abs(a[3 * nb :])))))
        turn = max(turn, self.frequency)
        return speed, max(turn, speed / self.size)


def _find_agreement(system: MultibodySystem, start: State, t_end: float) -> Orbit | None:
    """The orbit of the first level on which both routes agree to the end; else the one that reaches furthest."""
    motion, best = _Motion(system, start, t_end, max(BUDGET, 2.0 * _fewest(system))), None
    for level, (tolerance, correction) in enumerate(LEVELS):
        share = WORST if level == len(LEVELS) - 1 else AGREED
        with threadpool_limits(1):  # of matrices so small threads cost ten times what they save
            found = orbit.orbit_of(motion.pieces(tolerance, correction), partial(motion.share, share))
        if found is None:
            continue
        found = replace(found.until(WORST * motion.reach), stiff=motion.stiff)
        if best is None or (found.horizon, -found.bound[-1]) > (best.horizon, -best.bound[-1]):
            best = found
        enough = max(AGREED * motion.reach, FAR * float(np.max(np.abs(start.r), initial=0.0)))
        if found.horizon == t_end and (found.bound[-1] < enough or motion.stiff):
            break
    return best if best is not None and best.horizon > 0.0 else None
