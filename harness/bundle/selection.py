"""Which states of a run a bundle holds: all, or those of the maxima that decide on its status, as far as they fit."""

import numpy as np
from jaxtyping import Bool

from ..results.series import Series

ROOM = 18_000  # [bytes] of states for a run, as numbers; a run of which not one fits has none
DECIDING = (  # columns by whose maxima a run is judged, and beside them those that tables show
    "motion_error_judged_m", "energy_share_max", "gap_share_max", "gap_rate_share_max", "rate_error_judged_m_per_s",
    "orthogonality_max", "position_error_judged_m", "orientation_error_judged_rad", "energy_drift_max_J", "phi_max",
    "phi_dot_max",
)  # fmt: skip
BODY = 18 * 8  # [bytes] of r, R, v and Omega
STATE = ("r", "R", "v", "Omega")


def select_states(series: Series, room: int = ROOM) -> Bool[np.ndarray, " ns"]:
    """The states of the run that fit into ``room`` bytes, the first and the last before the others."""
    t = series["state_t"]
    known = np.isin(t, series["sample_t"]) if "sample_t" in series else np.zeros(len(t), dtype=bool)
    one = series["state_r"].shape[1] * BODY
    chosen = np.zeros(len(t), dtype=bool)
    for at in (*(series.peaks[name] for name in DECIDING if name in series.peaks), t[0], t[-1]):
        k = int(np.searchsorted(t, at))
        cost = 0 if k == len(t) or chosen[k] else one * (1 + known[k])
        if k < len(t) and cost <= room:
            chosen[k] = True
            room -= cost
    return chosen


def select_samples(series: Series, chosen: Bool[np.ndarray, " ns"], room: int = ROOM) -> Bool[np.ndarray, " nk"]:
    """The exact states at the times of these states and, as far as they fit, where the exact motion sets scales."""
    t = series["sample_t"]
    wanted = np.isin(t, series["state_t"][chosen])
    scales = np.isin(t, [at for name, at in series.peaks.items() if name.startswith("scale ")])
    fit = np.sum(scales) * series["sample_r"].shape[1] * BODY <= room
    return wanted | (scales & fit)
