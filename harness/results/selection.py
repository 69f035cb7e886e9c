"""Select the states of a run that a bundle holds: those of the maxima that decide its status, as far as they fit."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Int

from .series import BUNDLED, Series

ROOM = 14_000  # [bytes] of a run's states in a bundle at most, zeros not counted; states that do not fit are left out
ERRORS = (
    "motion_error_judged_m",
    "rate_error_judged_m_per_s",
    "position_error_judged_m",
    "orientation_error_judged_rad",
)
REACTIONS = "reaction_error_max_N", "moment_error_max_Nm"  # maxima at whose instants the reactions are kept too
LOADS = (*REACTIONS, "reaction_size_N", "moment_size_Nm")
BETWEEN = "motion_between_max_m"  # a maximum between two steps, both of which are kept
DECIDING = (  # columns whose maxima judge a run, and those that tables show
    ERRORS[0],
    "energy_share_max",
    "gap_share_max",
    "gap_rate_share_max",
    ERRORS[1],
    "orthogonality_max",
    *ERRORS[2:],
    *LOADS,
    BETWEEN,
    "energy_drift_max_J",
    "phi_max",
    "phi_dot_max",
)
STATE = ("r", "R", "v", "Omega")


def select_states(series: Series) -> tuple[Bool[np.ndarray, " ns"], Bool[np.ndarray, " nk"], bool]:
    """Return masks of the computed and of the exact states that a bundle holds, and whether it can judge between steps.

    A state is taken at each maximum that judges the run, in the order of ``DECIDING``, then at the start and the end;
    one that no longer fits into ``ROOM`` is left out. An error needs both the computed and the exact state; one between
    two steps needs the computed states of both steps, and the last value is True if they fit. The few exact states that
    set scales are always included. In a brief file the selection is stored.
    """
    if BUNDLED[0] in series:
        states, samples, around = (series[name] for name in BUNDLED)
        return states, samples, bool(around[0])
    t, sizes, room = series["state_t"], _measure_sizes(series, "state"), ROOM
    exact_t, exact_sizes = (
        (series["sample_t"], _measure_sizes(series, "sample")) if "sample_t" in series else (t[:0], sizes[:0])
    )
    exact = np.isin(exact_t, [at for name, at in series.peaks.items() if name.startswith("scale ")])
    chosen, between = np.zeros(len(t), dtype=bool), False
    for name, at in (
        *((name, series.peaks[name]) for name in DECIDING if name in series.peaks),
        *(("end", at) for at in (*t[:1], *t[-1:])),
    ):
        here, there = t == at, (exact_t == at) & ~exact & (name in (*ERRORS, *LOADS, BETWEEN))
        if name == BETWEEN:  # both steps around this time
            k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
            here = np.isin(np.arange(len(t)), (k, k + 1))
        here &= ~chosen
        cost = np.sum(sizes[here]) + np.sum(exact_sizes[there])
        if cost <= room:
            chosen |= here
            exact |= there
            room -= cost
            between |= name == BETWEEN and bool(at < t[-1])  # the last step but one may not be in the series
    return chosen, exact, between


def leave_out_states(arrays: Mapping[str, np.ndarray], peaks: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Return the arrays of a brief file: of all computed and exact states only those that are needed later.

    These are the states that a bundle holds (``select_states``, whose masks are stored as ``BUNDLED``), and those by
    which reactions are judged. ``peaks`` are the times of the maxima [s], by column of the record.
    """
    chosen, exact, between = select_states(Series(arrays, (), (), (), {}, {}, peaks))
    at = arrays["state_t"]
    kept = {"state": chosen | np.isin(at, [peaks[name] for name in REACTIONS if name in peaks]), "sample": exact}
    chosen_of = dict(zip(BUNDLED, (chosen[kept["state"]], exact[exact], np.array([between])), strict=True))
    rows = {k: a[kept[kind]] for kind in kept for k, a in arrays.items() if k.startswith(f"{kind}_")}
    return {**arrays, **rows, **chosen_of}


def _measure_sizes(series: Series, kind: str) -> Int[np.ndarray, " n"]:
    """Return the size [bytes] of each computed (``kind`` is ``state``) or exact (``sample``) state.

    Zeros do not count, since they take no room in a bundle.
    """
    found = (np.count_nonzero(series[f"{kind}_{name}"].reshape(len(series[f"{kind}_t"]), -1), axis=1) for name in STATE)
    return 8 * np.sum(list(found), axis=0)
