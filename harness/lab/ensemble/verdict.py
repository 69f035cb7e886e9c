"""Compare a solver's cloud with the true one: scores, ranks, spread, bias, and what the data show."""

import math
from dataclasses import dataclass

import numpy as np

from ...judge.distance import find_significant_tests
from .clouds import Cloud, Ensemble
from .scores import Ranks, count_ranks, score_against_truth

FEWEST = 10  # members that a comparison requires
ALL_C = "all C"
NO_DIFFERENCE = "no difference found"


@dataclass(frozen=True)
class CloudComparison:
    """The comparison of one quantity at one time; ``score`` is the CRPS or, for ``ALL_C``, the energy score."""

    solver: str
    setting: str
    quantity: str
    unit: str
    t_s: float
    members: int
    missing: int
    error: float  # rms distance of members from the true ones with the same starts
    score: float = math.nan
    excess: float = math.nan  # score minus that of the truth: 0 on average for a perfect solver
    chance: float = math.nan  # a perfect solver's excess stays below in 95 of 100 cases
    p_score: float = math.nan
    spread: float = math.nan  # standard deviation; rms for "all C"
    error_of_mean: float = math.nan  # rms distance of true draws from the mean, relative to what the spread predicts
    bias: float = math.nan  # mean less true mean; its length for "all C"
    bias_error: float = math.nan  # standard error of the bias
    ranks: Ranks | None = None  # None for "all C"


def compare_clouds(e: Ensemble, cloud: Cloud, same: Cloud, other: Cloud) -> list[CloudComparison]:
    """Return comparisons of a solver's ``cloud`` with two clouds of the truth: for each quantity at each time of ``e``.

    ``same`` are the true motions from the starts of ``cloud``, member by member, for errors; ``other`` are true motions
    from other starts, any number of them, by which it is scored. Quantities: the centres of mass of all bodies [m, rms
    over bodies], then each observable of ``e`` [its unit]. Members that did not get so far are counted as missing; with
    fewer than ``FEWEST`` left on either side all numbers but the error are NaN.
    """
    out = []
    for k, t in enumerate(e.at):
        size = np.sqrt(e.problem.system.nb)
        points = [c.C[:, k].reshape(len(c.C), -1) / size for c in (cloud, same, other)]
        out.append(_compare_quantity(e, cloud, (ALL_C, "m", t), *points))
        for i, o in enumerate(e.observables):
            numbers = [c.values[:, i, k] for c in (cloud, same, other)]
            out.append(_compare_quantity(e, cloud, (o.name, o.unit, t), *numbers))
    return out


def judge_comparisons(found: list[CloudComparison]) -> str:
    """Return the verdict on all comparisons of a solver together.

    It is ``NO_DIFFERENCE``, or names the quantities that differ, or says that members are missing or too few.
    """
    missing = max(c.missing for c in found)
    known = [(p, c) for c in found for p in (c.p_score, c.ranks.p if c.ranks else np.nan) if np.isfinite(p)]
    tests = [(p, f"{c.quantity} at {c.t_s:g} s") for p, c in known]
    if not tests:
        return "too few members"
    if off := find_significant_tests(tests):
        return f"differs from the truth: {', '.join(off)}"
    return f"incomplete: {missing} missing" if missing else NO_DIFFERENCE


def _compare_quantity(
    e: Ensemble, cloud: Cloud, about: tuple[str, str, float], x: np.ndarray, same: np.ndarray, other: np.ndarray
) -> CloudComparison:
    """Return one row of ``compare_clouds``: ``about`` is its quantity, unit and time [s].

    ``x`` are values of the solver's members, ``same`` true ones from the same starts, ``other`` true ones from others.
    """
    quantity, unit, t = about
    there, paired, drawn = (np.isfinite(a.reshape(len(a), -1)).all(axis=1) for a in (x, same, other))
    error = _rms(x[there & paired] - same[there & paired])
    head = (cloud.code.name, cloud.code.setting, quantity, unit, t, int(np.sum(there)), int(np.sum(~there)), error)
    x, y = x[there], other[drawn]
    if min(len(x), len(y)) < FEWEST:
        return CloudComparison(*head)
    found = score_against_truth(x, y, e.seed)
    n, m = len(x), len(y)
    own, true = (a - np.mean(a, axis=0) for a in (x, y))
    spread, of_truth = _rms(own) * np.sqrt(n / (n - 1.0)), _rms(true) * np.sqrt(m / (m - 1.0))
    shift = np.mean(x, axis=0) - np.mean(y, axis=0)
    bias = float(np.linalg.norm(shift)) if x.ndim > 1 else float(shift)
    predicted = spread * np.sqrt(1.0 + 1.0 / n)
    of_mean = _rms(y - np.mean(x, axis=0)) / predicted if predicted > 0.0 else np.nan
    bias_error = float(np.hypot(spread / np.sqrt(n), of_truth / np.sqrt(m)))
    ranks = count_ranks(x, y) if x.ndim == 1 else None
    return CloudComparison(*head, *found, float(spread), float(of_mean), bias, bias_error, ranks)


def _rms(a: np.ndarray) -> float:
    """Return the root mean square of numbers, or of the lengths of the rows; NaN if there are none."""
    return float(np.sqrt(np.sum(a * a) / len(a))) if len(a) else float("nan")
