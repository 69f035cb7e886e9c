"""The shadow of a computed motion: the true motion nearest to it, in joint coordinates, and how far it is."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ...solvers.formulations.joint_coordinates.counting import refuse_code
from ...solvers.formulations.joint_coordinates.tree import spanning_tree
from ..clock import cpu_seconds
from ..mechanics.motion import energy
from ..mechanics.state import States
from ..metrics.scales import displacement, speeds
from ..types import Problem, Trajectory
from .coordinates import coordinates_of
from .equations import Equations
from .flow import flow
from .plane import is_plane, with_hinges
from .refinement import Refinement

SHARE = 0.25  # of the time that the motion takes for its reach: the weight of velocities, as a power of 2
SEGMENT = 1 / 3  # of that time
MOST_STEPS = 24  # of the flow in a segment: where the motion whips, segments are shorter
GAP = 1e-8  # [m] in the metric: a motion with larger gaps is not a true one
HALVINGS = 4  # of the time, where no shadow is found
FEWEST = 8  # nodes


@dataclass(frozen=True)
class Shadow:
    """The true motion that was found, at the nodes, beside the computed one."""

    t: Float[np.ndarray, " nodes"]
    given: States
    true: States
    matter: Float[np.ndarray, "nodes nb"]  # [m] rms over the matter of a body
    reach: float  # [m] of the given motion
    tau: float  # [s] weight of velocities in the metric
    in_plane: bool
    gap: float  # [m] the largest that is left
    iterations: int
    t_end: float  # [s] sought up to here
    glitch: float  # [s] where the largest gap stayed in the shortest time without a shadow; NaN if there is none
    energy_shift: float  # [J] at the start
    cpu_s: float

    @property
    def is_complete(self) -> bool:
        """Whether there is a shadow over the whole time."""
        return self.gap < GAP and math.isnan(self.glitch)

    @property
    def until(self) -> float:
        """[s] the longest time over which a shadow was found; 0 where there is none."""
        return float(self.t[-1]) if self.gap < GAP else 0.0

    @property
    def distance(self) -> Float[np.ndarray, "nodes nb"]:
        """[m] between the centres of mass."""
        return np.linalg.norm(self.given.r - self.true.r, axis=2)


def find_shadow(problem: Problem, trajectory: Trajectory, t_end: float | None = None) -> Shadow:
    """Find the true motion nearest to ``trajectory``: poses and velocities of the bodies of ``problem`` at its rows.

    It is sought over the first ``t_end`` [s], by default all; where none is found, over a half, a quarter ... of them.
    Returns both motions at the nodes, rows a segment apart, and how far apart they are [m]; ``until`` [s] says over
    which time a shadow exists, and is 0 where none was found. ValueError where none can be sought: fewer than
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
    if why := refuse_code(problem):
        raise ValueError(f"no shadow of {problem.name}: it {why.split(': use')[0]}")
    system, start = problem.system, States.one(problem.initial)
    far = displacement(system, given, start)
    reach, share = float(np.max(far)), system.mass / np.sum(system.mass)
    if reach == 0.0:
        raise ValueError("a motion at rest has no shadow to look for")
    slow = math.sqrt(float(np.mean(far**2 @ share)) / max(float(np.mean(speeds(system, given) ** 2 @ share)), 1e-300))
    tau = 2.0 ** round(math.log2(SHARE * slow))
    planar = is_plane(problem, given, reach)
    if planar and problem.planar_normal is not None:
        system = with_hinges(system, problem.initial, problem.frame @ problem.planar_normal)
    E = Equations(system, spanning_tree(system, problem.initial))
    y = coordinates_of(E.tree, given)
    nodes = choose_nodes(E, t, y, SEGMENT * tau)
    glitch = math.nan
    for halving in range(HALVINGS + 1):
        own = nodes[t[nodes] <= t[-1] * 0.5**halving * (1.0 + 1e-12)]
        if len(own) < FEWEST:
            break
        refinement = Refinement(E, t[own], y[own], tau)
        if refinement.close():
            refinement.approach()
            break
        glitch = float(t[own][int(np.argmax(np.linalg.norm(np.nan_to_num(refinement.gaps, nan=np.inf), axis=1)))])
    own, there = refinement.t, given.at(nodes[: len(refinement.t)])
    true = E.bodies(own, refinement.y)
    shift = energy(problem.system, true.at(slice(1))) - energy(problem.system, start)
    return Shadow(
        own, there, true, displacement(problem.system, there, true), reach, tau, planar, refinement.gap,
        refinement.iterations, float(t[-1]), glitch, float(shift[0]), cpu_seconds() - began,
    )  # fmt: skip


def choose_nodes(
    E: Equations, t: Float[np.ndarray, " nt"], y: Float[np.ndarray, "nt ny"], length: float
) -> Int[np.ndarray, " nodes"]:
    """Rows about ``length`` [s] apart, closer where the flow takes many steps."""
    even = np.unique(np.searchsorted(t, np.arange(t[0], t[-1], length)))
    even = np.append(even[even < len(t) - 1], len(t) - 1)
    steps = np.ones(len(even) - 1, dtype=np.int64)
    ends = flow(E, t[even[:-1]], np.diff(t[even]), y[even[:-1]], steps)
    pieces: Int[np.ndarray, " n"] = np.where(np.isfinite(ends).all(axis=1), -(-steps // MOST_STEPS), 1)
    parts = [np.round(np.linspace(a, b, n + 1)) for a, b, n in zip(even[:-1], even[1:], pieces, strict=True)]
    return np.unique(np.concatenate(parts)).astype(np.int64)
