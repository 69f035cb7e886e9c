"""Eight ways to falsify an exact motion, each of which a referee has to catch."""

from collections.abc import Callable

import numpy as np

from mbsbench import Problem, States, Status, Trajectory
from mbsbench.harness.judge.distance import find_inaccuracy
from mbsbench.harness.judge.law import list_broken_laws
from mbsbench.harness.judge.metrics.measure import measure
from mbsbench.harness.judge.metrics.summary import make_columns

from .judging import Sizes, errors
from .motion import BEYOND

ROWS = 1001
FALSE = 0.01  # of a size: a change that moves less, as of a rotation that is symmetric, falsifies nothing
Change = Callable[[Sizes, np.ndarray, States], tuple[np.ndarray, States]]


def exact(sizes: Sizes, t: np.ndarray) -> States:
    """The true motion at ``t``, its start to the bit as declared."""
    r, R, v, w = sizes.truth.bodies(t)
    d = sizes.declared
    r[0], R[0], v[0], w[0] = d.r, d.R, d.v, d.w
    return States(r, R, v, np.einsum("tbji,tbj->tbi", R, w))


def _frozen(sizes: Sizes, t: np.ndarray, s: States) -> tuple[np.ndarray, States]:
    return t, s.at(np.zeros(len(t), dtype=int))


def _faster(factor: float) -> Change:
    def change(sizes: Sizes, t: np.ndarray, s: States) -> tuple[np.ndarray, States]:
        f = np.where(t > 0.0, factor, 1.0)[:, None, None]
        return t, States(s.r, s.R, f * s.v, f * s.Omega)

    return change


def _transposed(sizes: Sizes, t: np.ndarray, s: States) -> tuple[np.ndarray, States]:
    return t, States(s.r, np.swapaxes(s.R, 2, 3), s.v, s.Omega)


def _other_frame(sizes: Sizes, t: np.ndarray, s: States) -> tuple[np.ndarray, States]:
    return t, States(s.r, s.R, s.v, np.einsum("tbij,tbj->tbi", s.R, s.Omega))


def _too_fast(sizes: Sizes, t: np.ndarray, s: States) -> tuple[np.ndarray, States]:
    s, f = exact(sizes, BEYOND * t), np.where(t > 0.0, BEYOND, 1.0)[:, None, None]
    return t, States(s.r, s.R, f * s.v, f * s.Omega)


def _sinking(sizes: Sizes, t: np.ndarray, s: States) -> tuple[np.ndarray, States]:
    down = 0.2 * sizes.reach * np.array([0.0, 0.0, -1.0])
    away = (t / t[-1])[:, None, None] * down
    return t, States(s.r + away, s.R, s.v + (t > 0.0)[:, None, None] * down / t[-1], s.Omega)


def _early(sizes: Sizes, t: np.ndarray, s: States) -> tuple[np.ndarray, States]:
    n = 7 * len(t) // 10
    return t[:n], s.at(slice(0, n))


CHANGES: dict[str, Change] = {
    "frozen": _frozen,
    "reversed": _faster(-1.0),
    "1.1 v": _faster(1.1),
    "transposed R": _transposed,
    "wrong frame": _other_frame,
    "1.5 times too fast": _too_fast,
    "sinking": _sinking,
    "ends early": _early,
}


def is_accused(problem: Problem, t: np.ndarray, s: States) -> list[str]:
    """The laws that a motion breaks that claims success, or by which it is inaccurate."""
    run = Trajectory(t, s, Status.SUCCESS, "", {})
    with np.errstate(all="ignore"):
        m = measure(problem, run)
        c = make_columns(problem, run, m)
        return [r.law for r in (*list_broken_laws(problem, run, m, c), *find_inaccuracy(m, c))]


def falsify(sizes: Sizes, problem: Problem) -> dict[str, str]:
    """For each kind: caught, missed, or no other motion; for the exact one: right or accused."""
    t = np.linspace(0.0, problem.t_end, ROWS)
    s = exact(sizes, t)
    laws = is_accused(problem, t, s)
    out = {"exact": f"false alarm: {', '.join(laws)}" if laws else "right"}
    for kind, change in CHANGES.items():
        at, false = change(sizes, t, s)
        with np.errstate(all="ignore"):
            moved = max(v for v in errors(sizes, problem, at, false, None).values() if not np.isnan(v))
        if moved <= FALSE and kind != "ends early":
            out[kind] = "no other motion"
        else:
            out[kind] = "caught" if is_accused(problem, at, false) else "missed"
    return out
