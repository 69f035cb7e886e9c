"""Find the steps at which reported maxima occur; a series keeps their full states, so that all can be computed anew."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Int

from ...columns.measured import MeasuredMotion, MeasuredSeries, Scales
from ...columns.numbers import count_predictable
from ...mechanics.types import ACCURATE, Law
from .measure import JOINTS
from .summary import list_values_along

EVEN, BODIES = 64, 512  # most evenly picked steps; most states of single bodies in them, for large systems
SHARES = {  # columns with the largest residual of each law over its limit
    Law.ENERGY: "energy_share_max",
    Law.CONSTRAINT: "gap_share_max",
    Law.CONSTRAINT_RATE: "gap_rate_share_max",
    Law.ORTHOGONALITY: "orthogonality_max",
}


def find_peaks(run: MeasuredMotion) -> dict[str, int]:
    """Return the index of the step at which each reported maximum occurs, by the name of its column.

    A law that exceeds its limit has also the first step at which it does, as ``<column>:first``. Laws on constraints
    are left out for a literal start, which opens the joints.
    """
    m = run.series
    found = {name: _find_largest(values) for name, _, values in list_values_along(run)}
    for law, name in SHARES.items():
        if run.problem.literal_start and law in JOINTS:
            continue
        shares = [np.abs(one.laws[law]) / one.size.limits[law] for one in m.mechanisms]
        worst = np.max(shares, axis=0)
        found[name] = _find_largest(worst)
        if np.any(broken := ~(worst <= 1.0)):
            found[f"{name}:first"] = int(np.argmax(broken))
    return found | dict(_list_error_peaks(m))


def _list_error_peaks(m: MeasuredSeries) -> Iterator[tuple[str, int]]:
    """Yield names of columns with their steps: of the largest errors, and of times at which errors pass a limit.

    Each error against the reference has two columns: its largest value over all compared steps, and over those while
    the motion is predictable. Nothing is yielded without a reference.
    """
    own = m.reference_own_error
    compared = 0 if own is None else int(np.sum(~np.isnan(own)))
    if own is None or compared == 0:
        return
    judged = max(count_predictable(m.t[:compared], own[:compared] / m.size.length), 1)
    for name, unit, error in (
        ("motion_error", "m", m.motion_error),
        ("position_error", "m", m.position_error),
        ("orientation_error", "rad", m.orientation_error),
        ("rate_error", "m_per_s", m.rate_error),
        ("velocity_error", "m_per_s", m.velocity_error),
        ("angular_velocity_error", "rad_per_s", m.angular_velocity_error),
    ):
        assert error is not None  # with a reference
        yield f"{name}_judged_{unit}", _find_largest(error[:judged])
        yield f"{name}_max_{unit}", _find_largest(error[:compared])
    yield "judged_to_s", judged - 1
    yield "compared_to_s", compared - 1
    assert m.motion_error is not None
    for name, level in ACCURATE.items():
        above = ~(m.motion_error[:compared] <= level * m.size.length + own[:compared])
        if np.any(above):
            yield name, int(np.argmax(above))


def choose_steps(m: MeasuredSeries, peaks: dict[str, int], nb: int, *, every: bool = False) -> Int[np.ndarray, " ns"]:
    """Return the steps whose states are stored: all if ``every``, else ``peaks`` and evenly picked pairs.

    The steps that set scales, the steps around maxima between steps, and both ends are stored as well. ``nb`` is the
    number of bodies: large systems have fewer pairs.
    """
    nt = len(m.t)
    if every:
        return np.arange(nt)
    even = np.linspace(0, nt - 1, min(nt, EVEN, max(2, BODIES // max(nb, 1)))).round().astype(np.int64)
    of_sizes = [k for size in _list_scales(m) for k in size.run_at]
    around = np.searchsorted(m.t, list(interpolate_peak_times(m).values()), side="right") - 1
    kept = np.unique(np.concatenate((even, even + 1, list(peaks.values()), of_sizes, around, around + 1, [0, nt - 1])))
    return kept[(kept >= 0) & (kept < nt)].astype(np.int64)


def find_scale_times(m: MeasuredSeries) -> dict[str, float]:
    """Return the times [s] at which the exact motion sets the system's scales, named ``scale 1``, ``scale 2`` ..."""
    return {f"scale {k + 1}": at for k, at in enumerate(m.size.exact_at)}


def interpolate_peak_times(m: MeasuredSeries) -> dict[str, float]:
    """Return the times [s] of the largest motion error between steps and of the largest joint loads, by column.

    Times of quantities that were not measured are left out.
    """
    found = {
        "motion_between_max_m": m.motion_between_s,
        "reaction_error_max_N": m.reaction_error_s,
        "reaction_size_N": m.reaction_size_s,
        "moment_error_max_Nm": m.moment_error_s,
        "moment_size_Nm": m.moment_size_s,
    }
    return {name: at for name, at in found.items() if np.isfinite(at)}


def choose_times(m: MeasuredSeries, steps: Int[np.ndarray, " ns"]) -> Float[np.ndarray, " n"]:
    """Return the times [s] at which the exact motion is stored: those of ``steps``, of scales and of maxima."""
    t = m.t[steps]
    times = [t[t <= m.reference_horizon * (1.0 + 1e-12)], *(size.exact_at for size in _list_scales(m))]
    return np.unique(np.concatenate([*times, np.array(list(interpolate_peak_times(m).values()))]))


def _list_scales(m: MeasuredSeries) -> list[Scales]:
    """Return the scales of the whole system, then those of each mechanism."""
    return [m.size, *(one.size for one in m.mechanisms)]


def _find_largest(a: np.ndarray) -> int:
    """Return the index of the largest |a|, or of the first NaN if there is one."""
    return int(np.argmax(np.abs(a)))
