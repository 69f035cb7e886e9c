"""Verdicts on trial: what a run's motion is by the true one, and whether its status says so.

Right is what is within a hundredth of its size: motion, velocities, energy, rows and, where they are told, reactions.
A right motion that is called wrong or inaccurate is a false alarm. A success beyond what a success is allowed, as far
as it was compared, is a false success.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mbsbench import Problem, States, Status
from mbsbench.harness.judge.metrics.reactions import compute_loads_on_bodies
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.series import Series

from .building import Declared
from .motion import INSTANTS, Bodies, Truth, displacement, energy, gyration, rate_distance

RIGHT = 0.01
# what docs/trust.md lets a success be off by, of its size; sizes here and there differ by less than the twentieth more
ALLOWED = {"motion": 0.105, "velocity": 1.05, "energy": 0.105, "rows": 0.0105, "reactions": 10.5}
LOOKED_AT = 2000  # rows of a run


@dataclass(frozen=True)
class Sizes:
    """What errors of a mechanism's motion are compared with."""

    truth: Truth
    declared: Declared

    @cached_property
    def _motion(self) -> tuple[np.ndarray, Bodies]:
        t = np.linspace(0.0, self.declared.t_end, 1001)
        return t, self.truth.bodies(t)

    @cached_property
    def reach(self) -> float:
        """[m] how far a body's matter moves from its start."""
        _, s = self._motion
        first = tuple(x[:1] for x in s)
        return float(np.max(displacement(self.declared, s, first)))  # type: ignore[arg-type]

    @cached_property
    def speed(self) -> float:
        """[m/s] the largest of a body."""
        _, s = self._motion
        still = (s[0], s[1], 0.0 * s[2], 0.0 * s[3])
        return float(np.max(rate_distance(self.declared, s, still)))

    @cached_property
    def energy(self) -> float:
        """[J] the largest T or the span of V."""
        t, s = self._motion
        T, V = energy(self.declared, self.wound(t), s)
        return float(max(np.max(T), np.ptp(V)))

    @cached_property
    def keeps_energy(self) -> bool:
        """Return whether the true motion keeps its energy: no drive, load or damper changes it."""
        t, s = self._motion
        return bool(np.ptp(np.sum(energy(self.declared, self.wound(t), s), axis=0)) < 1e-6 * self.energy)

    def wound(self, t: np.ndarray) -> np.ndarray:
        """[rad] angles of torsional springs from rest."""
        return self.truth.values(t)[:, 13 * self.truth.equations.n :]


def errors(sizes: Sizes, problem: Problem, t: np.ndarray, s: States, reaction: np.ndarray | None) -> dict[str, float]:
    """Largest errors over the sizes; NaN where there is none."""
    d, truth = sizes.declared, sizes.truth
    pick = np.unique(np.linspace(0, len(t) - 1, min(len(t), LOOKED_AT)).round().astype(int))
    t, here = t[pick], s.at(pick).with_times(t[pick])  # rows of drives are functions of time
    w = np.einsum("tbij,tbj->tbi", here.R, here.Omega)
    run, true = (here.r, here.R, here.v, w), truth.bodies(t)
    out = {
        "motion": float(np.max(displacement(d, run, true))) / sizes.reach,
        "velocity": float(np.max(rate_distance(d, run, true))) / sizes.speed,
    }
    near = sizes.wound(t)
    wound = near.copy()
    e = truth.equations
    for k, x in enumerate(d.torsions):
        wound[:, k] = [e._angle(x, R, a + x.rest_angle) - x.rest_angle for R, a in zip(here.R, near[:, k], strict=True)]
    E, E_true = (sum(energy(d, angle, b)) for angle, b in ((wound, run), (near, true)))
    out["energy"] = float(np.max(np.abs(E - E_true))) / sizes.energy
    some = pick_evenly(len(t))
    phi = np.array([np.abs(e.rows(t[k], here.r[k], here.R[k], here.v[k], w[k])[0]) for k in some])
    lengths = np.ones(phi.shape[1])
    lengths[: len(e.points[0])] = sizes.reach
    lengths[phi.shape[1] - len(e.racks) :] = sizes.reach
    out["rows"] = float(np.max(phi / lengths, initial=0.0))
    out["reactions"] = math.nan
    if reaction is not None and len(some):
        told = compute_loads_on_bodies(problem.system, reaction[pick][some], here.at(some))
        exact = truth.loads(t[some])
        off = told - exact
        force = float(np.max(np.linalg.norm(exact[..., :3], axis=-1)))
        moment = max(float(np.max(np.linalg.norm(exact[..., 3:], axis=-1))), force * float(np.max(gyration(d))))
        if np.any(np.isfinite(off)) and force > 0.0:
            both = (np.linalg.norm(off[..., :3], axis=-1) / force, np.linalg.norm(off[..., 3:], axis=-1) / moment)
            out["reactions"] = float(np.max(np.maximum(*both)))
    return out


def pick_evenly(n: int) -> np.ndarray:
    """Rows after the start."""
    return np.unique(np.linspace(1, n - 1, min(n - 1, INSTANTS)).round().astype(int))


@dataclass(frozen=True)
class Finding:
    """A run, how far its errors are of their sizes, and what is wrong with its status; empty if nothing."""

    case: str
    status: str
    shares: dict[str, float]
    fault: str = ""
    laws: str = ""  # by which it is called wrong
    because: str = ""  # it did not reach the end, in its own words

    def __str__(self) -> str:
        by = f" by {self.laws}" if self.laws else ""
        words = ", ".join(f"{k} {v:.2g}" for k, v in self.shares.items() if not math.isnan(v))
        return f"{self.case}: {self.status}{by}; of their sizes: {words}"


def laws_of(record: RunRecord) -> str:
    """By which laws it is called wrong or inaccurate, and of what."""
    found = [f"{reason.law} ({reason.name})" if reason.name else reason.law for reason in record.reasons]
    return ", ".join(dict.fromkeys(found))


def is_right(shares: dict[str, float]) -> bool:
    """Whether all that is told is within a hundredth."""
    return all(v <= RIGHT for k, v in shares.items() if not (k == "reactions" and math.isnan(v)))


def judge_run(sizes: Sizes, problem: Problem, record: RunRecord, series: Series | None) -> Finding:
    """What the truth says of a run that claimed to reach its end."""
    if record.status not in (Status.SUCCESS, Status.INACCURATE, Status.WRONG):
        return Finding(record.case, record.status, {}, because=record.message)
    if series is None:
        fault = "false success" if record.status == Status.SUCCESS else ""
        return Finding(record.case, record.status, {}, fault, because="its series is lost")
    a = series.arrays
    t, reaction = a["state_t"], a.get("state_reaction")
    s = States(a["state_r"], a["state_R"], a["state_v"], a["state_Omega"])
    if not all(np.all(np.isfinite(x)) for x in (s.r, s.R, s.v, s.Omega)) or t[-1] < 0.999 * problem.t_end:
        shares = {"motion": math.inf}
        fault = "false success" if record.status == Status.SUCCESS else ""
        return Finding(record.case, record.status, shares, fault)
    with np.errstate(all="ignore"):
        shares = errors(sizes, problem, t, s, reaction)
    if record.status != Status.SUCCESS:
        laws = laws_of(record)
        return Finding(record.case, record.status, shares, "false alarm" if is_right(shares) else "", laws)
    compared = t <= record.judged_to_s * (1.0 + 1e-9)
    if np.count_nonzero(compared) < 2:
        return Finding(record.case, record.status, shares, "")
    if not np.all(compared):
        known = None if reaction is None else reaction[compared]
        with np.errstate(all="ignore"):
            shares = errors(sizes, problem, t[compared], s.at(np.flatnonzero(compared)), known)
    # a success owes a balance of energy and work; where work is done, the energy beside the true motion's is not that
    beyond = [k for k, most in ALLOWED.items() if shares[k] > most and (k != "energy" or sizes.keeps_energy)]
    return Finding(record.case, record.status, shares, "false success" if beyond else "")
