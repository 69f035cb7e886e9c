"""Which states of a run a bundle holds: all, or those of the maxima that decide on its status, as far as they fit."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Int

from .series import BUNDLED, Series

ROOM = 14_000  # [bytes] of the states of a run, numbers that are zero left out; a run of which not one fits has none
ERRORS = (
    "motion_error_judged_m", "rate_error_judged_m_per_s", "position_error_judged_m", "orientation_error_judged_rad",
)  # fmt: skip
FORCES = REACTION, _ = "reaction_error_max_N", "reaction_size_N"
BETWEEN = "motion_between_max_m"  # between two steps, which are kept
DECIDING = (  # columns by whose maxima a run is judged, and beside them those that tables show
    ERRORS[0], "energy_share_max", "gap_share_max", "gap_rate_share_max", ERRORS[1], "orthogonality_max", *ERRORS[2:],
    *FORCES, BETWEEN,
    "energy_drift_max_J", "phi_max", "phi_dot_max",
)  # fmt: skip
STATE = ("r", "R", "v", "Omega")


def select_states(series: Series) -> tuple[Bool[np.ndarray, " ns"], Bool[np.ndarray, " nk"], bool]:
    """The states of the run that fit, of the maxima in order, then the first and the last; the exact ones beside them.

    An error takes both states; that between two steps both of these, and the last value tells whether they fit. The
    exact states that set scales are there too: few of systems that have a reference. A brief file tells.
    """
    if BUNDLED[0] in series:
        states, samples, around = (series[name] for name in BUNDLED)
        return states, samples, bool(around[0])
    t, sizes, room = series["state_t"], _sizes(series, "state"), ROOM
    exact_t, exact_sizes = (
        (series["sample_t"], _sizes(series, "sample")) if "sample_t" in series else (t[:0], sizes[:0])
    )
    exact = np.isin(exact_t, [at for name, at in series.peaks.items() if name.startswith("scale ")])
    chosen, between = np.zeros(len(t), dtype=bool), False
    for name, at in (*((name, series.peaks[name]) for name in DECIDING if name in series.peaks),
                     *(("end", at) for at in (*t[:1], *t[-1:]))):  # fmt: skip
        here, there = t == at, (exact_t == at) & ~exact & (name in (*ERRORS, *FORCES, BETWEEN))
        if name == BETWEEN:
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
    """The arrays of a series file with the states that a bundle takes and that of the largest error of a reaction."""
    chosen, exact, between = select_states(Series(arrays, (), (), (), {}, {}, peaks))
    at = arrays["state_t"]
    kept = {"state": chosen | (at == peaks.get(REACTION, np.nan)), "sample": exact}
    chosen_of = dict(zip(BUNDLED, (chosen[kept["state"]], exact[exact], np.array([between])), strict=True))
    rows = {k: a[kept[kind]] for kind in kept for k, a in arrays.items() if k.startswith(f"{kind}_")}
    return {**arrays, **rows, **chosen_of}


def _sizes(series: Series, kind: str) -> Int[np.ndarray, " n"]:
    """[bytes] of each state, of the numbers that are not zero."""
    found = (np.count_nonzero(series[f"{kind}_{name}"].reshape(len(series[f"{kind}_t"]), -1), axis=1) for name in STATE)
    return 8 * np.sum(list(found), axis=0)
