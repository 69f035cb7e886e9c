"""The metamorphic scorecard: what must hold of a solver whatever the motion is, so that no reference is needed.

Each check compares two runs that differ in one thing the physics does not see: frame, mirror image, numbering, units, a
joint told twice, or the direction of time. How far apart they may end is not chosen: it is ``SLACK`` times what the
same solver's end moves by at a tenth of its tolerance, plus rounding times the growth of a start changed by 1e-10, plus
for fixed steps ``HALVES`` times what it moves by at half the step. Two runs of one motion may differ by their errors,
all solvers alike; whether a fixed step keeps a symmetry exactly, without that last part, is said beside the verdict.
No verdict is made of what is not a finite number; a bound above the mechanism's size decides nothing.
Distances are of whole poses, max over bodies of |r - r'| and L times the angle of R to R', L the mechanism's size.
"""

import functools
import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Float

from ...mechanics import so3
from ...results import store
from ...results.records import RunRecord
from ...results.words import words_of_ending

SLACK = 10.0  # errors of one tolerance scatter by several times: steps fall differently
HALVES = 3.0  # one run may err by 4/3 of its change at half the step, the other by as much the other way
TENTH = (0.05, 0.2)  # of the tolerance: what counts as a tenth
ROUNDING = 2.2e-16  # a step, relative; steps add up
CHANGES: Mapping[str, str] = {
    "retrace": "time reversal",
    "yaw": "yaw",
    "rotation": "rotation",
    "mirror": "mirror image",
    "renumber": "renumbering",
    "unit_length": "unit of length",
    "unit_mass": "unit of mass",
    "unit_time": "unit of time",
    "duplicate": "repeated joint",
}
TOLERANCE = 1e-8  # default of solvers with a fixed step; they take it from options, where it stands if it differs


@dataclass(frozen=True)
class Yardstick:
    """What two runs of a solver on a variant may differ by."""

    level: float  # [m] change of the end at a tenth of the tolerance
    halved: float  # [m] and at half the step; 0 under error control
    growth: float  # of a relative change of the start, at the end
    steps: int
    size: float  # [m] of the mechanism

    @property
    def exact(self) -> float:
        """[m] what is left when a scheme keeps a symmetry exactly."""
        return SLACK * self.level + self.rounding

    @property
    def bound(self) -> float:
        """[m] what errors of the scheme allow."""
        return self.exact + HALVES * self.halved

    @property
    def rounding(self) -> float:
        """[m] every step's rounding, grown to the end."""
        return SLACK * ROUNDING * self.steps * max(self.growth, 1.0) * self.size

    @property
    def back(self) -> float:
        """Factor of the way back: what is off at the end grows once more."""
        return 1.0 + max(self.growth, 1.0)


def scorecard(folder: Path, records: Iterable[RunRecord]) -> list[dict[str, Any]]:
    """One entry a solver, check and variant, as in ``metamorphic.json``."""
    known = {_key(r): r for r in sorted(records, key=lambda r: (r.finished, r.settings_id))}
    runs = sorted(known.values(), key=lambda r: (r.problem, r.problem_parameters, r.solver, r.settings_id))
    ends = _Ends(folder)
    by_rest, by_tolerance, by_halving = (_grouped(runs, key) for key in (_rest, _but_tolerance, _halving))
    found = []
    for base in runs:
        kin, others, finer = by_rest[_rest(base)], by_tolerance[_but_tolerance(base)], by_halving[_halving(base)]
        told = [r for r in kin if _changed(base, r)]
        tighter = min((r for r in others if _is_tighter(base, r)), key=lambda r: _off(base, r), default=None)
        nudged = min((r for r in kin if _is_nudged(base, r)), key=lambda r: (_nudge(r), r.settings_id), default=None)
        halved = next((r for r in finer if 2.0 * r.dt_s == base.dt_s), None)
        if not told or tighter is None or nudged is None or (halved is None and base.control == "dt"):
            continue
        found.append((base, told, _yardstick(base, tighter, nudged, halved, ends)))
    out = []
    for base, told, own in found:
        yard = own and replace(own, growth=_least_growth(base, [(b, y) for b, _, y in found if y is not None]))
        for r in sorted(told, key=lambda r: (list(CHANGES).index(_changed(base, r)), r.case)):
            out.append(_entry(base, r, _changed(base, r), yard, ends))
        out += [e for r in (base, *told) if (e := _planarity(base, r, yard)) is not None]
    return out


class _Ends:
    """Last poses of runs, read once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray] | None] = {}

    def of(self, r: RunRecord) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """r, R of all bodies and gravity, space frame; None where the run has none."""
        if r.run_id not in self._known:
            s = store.series_of(self._folder, r)
            self._known[r.run_id] = None if s is None else (s["end_r"], s["end_R"], s["gravity"])
        return self._known[r.run_id]

    def apart(self, one: RunRecord, other: RunRecord, turned: np.ndarray) -> float:
        """Distance [m] of the ends, ``other`` brought back from the frame ``turned``; NaN if one has none."""
        a, b = self.of(one), self.of(other)
        if a is None or b is None:
            return math.nan
        r, R = b[0] @ turned, turned.T @ b[1]
        gap = float(np.max(np.linalg.norm(r - a[0], axis=-1)))
        return float(np.maximum(gap, one.length_scale_m * np.max(so3.angle_between(R, a[1]))))


def _grouped(runs: Iterable[RunRecord], key: Callable[[RunRecord], tuple]) -> Mapping[tuple, list[RunRecord]]:
    """Thousands of runs are not compared each with each."""
    out: dict[tuple, list[RunRecord]] = {}
    for r in runs:
        out.setdefault(key(r), []).append(r)
    return out


def _parameters(r: RunRecord) -> Mapping[str, Any]:
    return _read(r.problem_parameters)


@functools.cache
def _read(text: str) -> Mapping[str, Any]:
    return MappingProxyType(json.loads(text))


def _rest(r: RunRecord) -> tuple:
    """All that shapes a run but the problem's parameters."""
    return (r.problem, r.solver, r.solver_options, r.control, str(r.dt_s), str(r.rtol), str(r.max_step_s))


def _key(r: RunRecord) -> tuple:
    return (*_rest(r), r.problem_parameters)


def _changed(base: RunRecord, r: RunRecord) -> str:
    """The one thing told otherwise in ``r``, all else alike; empty if it is none or more."""
    here, there = _parameters(base), _parameters(r)
    if any(k in CHANGES for k in here) or any(there.get(k) != v for k, v in here.items()):
        return ""
    more = [k for k in there if k not in here]
    return more[0] if len(more) == 1 and more[0] in CHANGES else ""


def _is_nudged(base: RunRecord, r: RunRecord) -> bool:
    return _nudge(r) > 0.0 and _without(r, "perturb") == _parameters(base)


def _nudge(r: RunRecord) -> float:
    return float(_parameters(r).get("perturb", 0.0))


def _without(r: RunRecord, name: str) -> dict[str, Any]:
    return {k: v for k, v in _parameters(r).items() if k != name}


def _is_tighter(base: RunRecord, r: RunRecord) -> bool:
    return TENTH[0] < _tolerance(r) / _tolerance(base) < TENTH[1]


def _but_tolerance(r: RunRecord) -> tuple:
    """All that shapes a run but the tolerance of its errors, or of its steps' equations."""
    options = {k: v for k, v in _read(r.solver_options).items() if not (r.control == "dt" and k == "tolerance")}
    step = (str(r.dt_s), str(r.max_step_s))
    return (r.problem, r.problem_parameters, r.solver, json.dumps(options, sort_keys=True), r.control, *step)


def _tolerance(r: RunRecord) -> float:
    return float(_read(r.solver_options).get("tolerance", TOLERANCE)) if r.control == "dt" else r.rtol


def _off(base: RunRecord, r: RunRecord) -> tuple[float, str]:
    """How far from a tenth a tighter run is."""
    return abs(math.log(10.0 * _tolerance(r) / _tolerance(base))), r.settings_id


def _halving(r: RunRecord) -> tuple:
    return (r.problem, r.problem_parameters, r.solver, r.solver_options, r.control, str(r.max_step_s))


def _yardstick(
    base: RunRecord, tighter: RunRecord, nudged: RunRecord, halved: RunRecord | None, ends: _Ends
) -> Yardstick | None:
    """None where one of the runs did not end well."""
    if any(r is not None and r.claimed != "success" for r in (base, tighter, nudged, halved)):
        return None
    level = ends.apart(base, tighter, np.eye(3))
    growth = ends.apart(base, nudged, np.eye(3)) / (_nudge(nudged) * base.length_scale_m)
    step = 0.0 if halved is None else ends.apart(base, halved, np.eye(3))
    return Yardstick(level, step, growth, base.steps, base.length_scale_m)


def _least_growth(base: RunRecord, found: Iterable[tuple[RunRecord, Yardstick]]) -> float:
    """Growth belongs to the motion; under error control a changed start moves the steps too, and seems to grow more."""
    same = [y.growth for b, y in found if (b.problem, b.problem_parameters) == (base.problem, base.problem_parameters)]
    return min((g for g in same if math.isfinite(g)), default=math.nan)


def _entry(base: RunRecord, r: RunRecord, change: str, yard: Yardstick | None, ends: _Ends) -> dict[str, Any]:
    told = _parameters(r)[change]
    title = f"{CHANGES[change]}{_how(change, told)}"
    deviation, bound = math.nan, math.nan
    if base.claimed != "success":
        verdict = "refused" if base.status == "refused" else "failed"
        said = words_of_ending(base)
        words = f"as it stands: {base.status}: {said}" if said else f"as it stands: {base.status}"
    elif yard is None:
        verdict, words = "failed", "no bound: the run at a tenth of the tolerance or from the changed start failed"
    elif r.claimed != "success":
        verdict = "refused" if r.status == "refused" else "failed"
        words = f"{r.status}: {words_of_ending(r)}"
    elif change == "renumber" and _single(ends, base):
        verdict, words = "not applicable", "one body and one joint have no order"
    elif change == "retrace":
        deviation = float(np.maximum(r.return_error_m, r.length_scale_m * r.return_error_rad))
        bound = yard.bound * yard.back
        verdict, words = _compared(deviation, yard, "misses the start", yard.back)
        if math.isnan(deviation):
            verdict, words = "failed", "; ".join(n for n in json.loads(r.notes) if "the way back" in n) or "no way back"
    else:
        found = ends.of(base)
        turned = np.eye(3) if found is None else _frame(change, told, found[2])
        deviation, bound = ends.apart(base, r, turned), yard.bound
        verdict, words = _compared(deviation, yard, "ends elsewhere")
    return _row(base, title, (deviation, bound), yard, verdict, words, [base.settings_id, r.settings_id])


def _planarity(base: RunRecord, r: RunRecord, yard: Yardstick | None) -> dict[str, Any] | None:
    """Planar motion must stay in its plane, as it stands and however it is told."""
    if math.isnan(r.out_of_plane_max_m) or yard is None or r.claimed != "success":
        return None
    if r is not base and _changed(base, r) not in ("yaw", "rotation"):
        return None
    title = "planar symmetry" if r is base else f"planar symmetry, {CHANGES[_changed(base, r)]}"
    deviation = r.out_of_plane_max_m
    verdict, words = _compared(deviation, yard, "leaves the plane")
    return _row(base, title, (deviation, yard.bound), yard, verdict, words, [r.settings_id])


def _compared(deviation: float, yard: Yardstick, what: str, grown: float = 1.0) -> tuple[str, str]:
    """Verdict and words; ``grown`` multiplies all that is allowed."""
    exact, bound = yard.exact * grown, yard.bound * grown
    if not math.isfinite(deviation):
        return "failed", "no end pose to compare"
    if not math.isfinite(bound):
        return "failed", "no bound: no end pose at a tenth of the tolerance, at half the step or from the changed start"
    parts = f"a tenth of the tolerance moves the end by {yard.level:.1e} m"
    if yard.halved > 0.0:
        parts += f", half the step by {yard.halved:.1e} m"
    parts += f", rounding by {yard.rounding / SLACK:.1e} m at most, a change of the start grows {yard.growth:.2g}-fold"
    if deviation > bound:
        times = f"{deviation / bound:.3g} times the {bound:.1e} m allowed" if bound > 0.0 else "nothing allowed"
        return "broken", f"{what} by {deviation:.1e} m, {times} ({parts})"
    kept = yard.halved > 0.0 and deviation <= exact
    if (exact if kept else bound) > yard.size:
        return "undecided", f"{what} by {deviation:.1e} m, but {bound:.1e} m allowed is more than its size ({parts})"
    if yard.halved == 0.0:
        return "holds", f"{what} by {deviation:.1e} m of {bound:.1e} m allowed ({parts})"
    if kept:
        return "holds", f"exactly: {what} by {deviation:.1e} m, as far as the steps are solved, {exact:.1e} m ({parts})"
    return "holds", f"not exactly, within its error: {what} by {deviation:.1e} m of {bound:.1e} m allowed ({parts})"


def _how(change: str, told: Any) -> str:
    if change.startswith("unit_"):
        return f" x {told:g}"
    return ""


def _single(ends: _Ends, r: RunRecord) -> bool:
    found = ends.of(r)
    return found is not None and len(found[0]) == 1


def _frame(change: str, told: Any, gravity: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Rotation from the frame as it stands to the one told, as the registry turns problems."""
    if change == "rotation":
        return so3.exp(np.array(told, dtype=float))
    if change == "yaw":
        g = float(np.linalg.norm(gravity))
        return so3.exp(float(told) * (-gravity / g if g > 0.0 else np.array([0.0, 0.0, 1.0])))
    return np.eye(3)


def _row(
    base: RunRecord,
    check: str,
    sizes: tuple[float, float],
    yard: Yardstick | None,
    verdict: str,
    words: str,
    specs: list[str],
) -> dict[str, Any]:
    deviation, bound = sizes
    return {
        "solver": base.solver,
        "options": json.loads(base.solver_options),
        "check": check,
        "problem": base.problem,
        "variant": base.case.split(" ")[0],
        "deviation": deviation,
        "bound": bound,
        "unit": "m",
        "exact": words.startswith("exactly") if yard is not None and yard.halved > 0.0 and deviation >= 0.0 else None,
        "verdict": verdict,
        "words": words,
        "runs": specs,
    }
