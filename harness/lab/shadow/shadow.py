"""Find the shadow of a computed motion: the true motion nearest to it, in joint coordinates, and its distance."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ...base.clock import cpu_seconds
from ...catalogue.offers import find_offer
from ...judge.distance import GAP
from ...judge.metrics.scales import measure_displacement, measure_speeds
from ...mechanics.joint_tree import build_spanning_tree
from ...mechanics.motion import energy
from ...mechanics.state import States
from ...mechanics.types import Problem, Trajectory
from .coordinates import compute_coordinates
from .equations import FlowEquations
from .flow import integrate_flow
from .plane import add_hinges, is_planar_motion
from .refinement import Refinement

FRACTION = 0.25  # fraction of the time that the motion takes for its own extent: weight of velocities, as a power of 2
SEGMENT = 1 / 3  # length of a segment relative to that time
MOST_STEPS = 24  # steps of the flow in a segment: where the motion whips, segments are shorter
HALVINGS = 4  # halvings of the time, where no shadow is found
FEWEST = 8  # nodes


@dataclass(frozen=True)
class Shadow:
    """The true motion that was found near a computed one, both at the nodes, and their distance."""

    t: Float[np.ndarray, " nodes"]
    given: States  # the computed motion
    true: States  # the true one
    matter: Float[np.ndarray, "nodes nb"]  # [m] rms over the matter of a body
    reach: float  # [m] of the given motion
    tau: float  # [s] weight of velocities in the metric
    in_plane: bool
    gap: float  # [m] largest remaining gap
    iterations: int
    t_end: float  # [s] end of the search
    glitch: float  # [s] time of the largest gap in the shortest motion without a shadow; NaN if there is none
    energy_shift: float  # [J] difference of the energies at the start
    cpu_s: float  # [s] CPU time of the search

    @property
    def is_complete(self) -> bool:
        """True if there is a shadow over the whole time."""
        return self.gap < GAP and math.isnan(self.glitch)

    @property
    def until(self) -> float:
        """Longest time [s] over which a shadow was found; 0 where there is none."""
        return float(self.t[-1]) if self.gap < GAP else 0.0

    @property
    def distance(self) -> Float[np.ndarray, "nodes nb"]:
        """Distances [m] between the centres of mass."""
        return np.linalg.norm(self.given.r - self.true.r, axis=2)


def find_shadow(problem: Problem, trajectory: Trajectory, t_end: float | None = None) -> Shadow:
    """Find the true motion nearest to ``trajectory``: poses and velocities of the bodies of ``problem`` at its rows.

    It is sought over the first ``t_end`` [s], by default all; where none is found, over a half, a quarter ... of them.
    Return both motions at the nodes, rows a segment apart, and their distances [m]; ``until`` [s] is the time over
    which a shadow exists, and is 0 where none was found. Raise ValueError where none can be sought: fewer than
    ``FEWEST`` rows, values that are not finite, a motion at rest, a mechanism without joint coordinates.
    """
    began = cpu_seconds()
    sought = min(t_end or math.inf, float(trajectory.t[-1]))
    rows = slice(int(np.sum(trajectory.t <= sought * (1.0 + 1e-12))))
    t, given = trajectory.t[rows], trajectory.states.at(rows)
    if len(t) < FEWEST:
        raise ValueError(f"a shadow needs a motion of at least {FEWEST} rows (got {len(t)})")
    if not all(np.all(np.isfinite(a)) for a in (given.r, given.R, given.v, given.Omega)):
        raise ValueError("the motion has values that are not finite; give a --t-end before them")
    if why := find_offer("expressions").refuse(problem):
        raise ValueError(f"no shadow of {problem.name}: it {why.split(': use')[0]}")
    system, start = problem.system, States.one(problem.initial)
    displacement = measure_displacement(system, given, start)
    reach, fractions = float(np.max(displacement)), system.mass / np.sum(system.mass)
    if reach == 0.0:
        raise ValueError("a motion at rest has no shadow to look for")
    time_scale = math.sqrt(
        float(np.mean(displacement**2 @ fractions))
        / max(float(np.mean(measure_speeds(system, given) ** 2 @ fractions)), 1e-300)
    )
    # a power of 2 near a fraction of the time in which the motion covers its extent
    tau = 2.0 ** round(math.log2(FRACTION * time_scale))
    planar = is_planar_motion(problem, given, reach)
    if planar and problem.planar_normal is not None:
        system = add_hinges(system, problem.initial, problem.frame @ problem.planar_normal)
    E = FlowEquations(system, build_spanning_tree(system, problem.initial))
    y = compute_coordinates(E.tree, given)
    nodes = choose_nodes(E, t, y, SEGMENT * tau)
    glitch = math.nan
    for halving in range(HALVINGS + 1):
        own = nodes[t[nodes] <= t[-1] * 0.5**halving * (1.0 + 1e-12)]
        if len(own) < FEWEST:
            break
        refinement = Refinement(E, t[own], y[own], tau)
        if refinement.close_gaps():
            refinement.approach_nearest()
            break
        glitch = float(t[own][int(np.argmax(np.linalg.norm(np.nan_to_num(refinement.gaps, nan=np.inf), axis=1)))])
    own, given_nodes = refinement.t, given.at(nodes[: len(refinement.t)])
    true = E.evaluate_bodies(own, refinement.y)
    shift = energy(problem.system, true.at(slice(1))) - energy(problem.system, start)
    return Shadow(
        own,
        given_nodes,
        true,
        measure_displacement(problem.system, given_nodes, true),
        reach,
        tau,
        planar,
        refinement.gap,
        refinement.iterations,
        float(t[-1]),
        glitch,
        float(shift[0]),
        cpu_seconds() - began,
    )


def choose_nodes(
    E: FlowEquations, t: Float[np.ndarray, " nt"], y: Float[np.ndarray, "nt ny"], length: float
) -> Int[np.ndarray, " nodes"]:
    """Return the numbers of rows about ``length`` [s] apart, closer where the flow takes many steps.

    ``t`` [s] and ``y`` are times and joint coordinates of all rows.
    """
    even = np.unique(np.searchsorted(t, np.arange(t[0], t[-1], length)))
    even = np.append(even[even < len(t) - 1], len(t) - 1)
    steps = np.ones(len(even) - 1, dtype=np.int64)
    ends = integrate_flow(E, t[even[:-1]], np.diff(t[even]), y[even[:-1]], steps)
    pieces: Int[np.ndarray, " n"] = np.where(np.isfinite(ends).all(axis=1), -(-steps // MOST_STEPS), 1)
    parts = [np.round(np.linspace(a, b, n + 1)) for a, b, n in zip(even[:-1], even[1:], pieces, strict=True)]
    return np.unique(np.concatenate(parts)).astype(np.int64)
