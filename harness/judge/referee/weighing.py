"""Weigh published false successes and broken symmetries again, from the few runs that decide whether they mislead.

A false success by a law of states stays one whatever its errors are. All others depend on errors of motion, velocities
and reactions that only records have. These runs are made again (``docs/weigh_false_successes.py``), a minute instead of
the hour of the whole suite, and must have the published numbers.
"""

import functools
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from ...base.files import FileError
from ...mechanics.types import Law
from ...results.judgements.runs import PLANARITY, FalseSuccess, Symmetry
from ...results.misleading import breaks_state_law
from ...results.records import RunRecord
from .certificates.symmetries import measure_deviation, read_last_poses
from .false_successes import find_false_successes, list_contradictions, weigh_break

SAME = 1e-6  # relative difference of two numbers of one run; other processors may round otherwise
Published = tuple[tuple[Symmetry, ...], tuple[FalseSuccess, ...]]


def list_deciding_runs(symmetries: Iterable[Symmetry], wrong: Iterable[FalseSuccess]) -> set[str]:
    """Return the settings_ids of the runs that decide whether broken symmetries and false successes mislead.

    False successes by a law of states are left out: no error can excuse them.
    """
    of_symmetries = {k for s in symmetries if s.verdict == "broken" for k in s.settings_ids}
    return of_symmetries | {w.settings_id for w in wrong if not breaks_state_law(w.because)}


def weigh_published(
    folder: Path, records: Iterable[RunRecord], symmetries: Sequence[Symmetry], wrong: Sequence[FalseSuccess]
) -> Published:
    """Return the published symmetries and false successes, weighed again by the records of the runs that decide.

    ``folder`` has the series of ``records``. Raise FileError if a run that decides (``list_deciding_runs``) is missing,
    or has other numbers than the published ones.
    """
    deciding = list_deciding_runs(symmetries, wrong)
    known = {r.settings_id: r for r in records if r.settings_id in deciding}
    if missing := sorted(deciding - known.keys()):
        raise FileError(f"{folder} lacks {len(missing)} of {len(deciding)} runs that decide, such as {missing[0]}")
    read = functools.cache(functools.partial(read_last_poses, folder))
    rows = []
    for s in symmetries:
        if s.verdict != "broken":
            rows.append(s)
            continue
        base, presented = known[s.settings_ids[0]], known[s.settings_ids[-1]]
        away = presented.out_of_plane_max_m if s.check == PLANARITY else measure_deviation(base, presented, read)
        _require_same(presented, s.deviation, away)
        rows.append(weigh_break(s, base, presented))
    for w in wrong:
        if r := known.get(w.settings_id):
            own = {(b.law, b.name): b.value for b in list_contradictions(r)}
            for b in w.because:
                if b.law is not Law.SYMMETRY:
                    _require_same(r, b.value, own.get((b.law, b.name), math.nan))
    stay = {w.settings_id: w for w in wrong if breaks_state_law(w.because)}
    found = stay | {w.settings_id: w for w in find_false_successes(known.values(), rows)}
    return tuple(rows), tuple(sorted(found.values(), key=lambda w: (w.problem, w.solver, w.case)))


def _require_same(r: RunRecord, published: float, measured: float) -> None:
    """Raise FileError unless both numbers are those of one run."""
    if not math.isclose(published, measured, rel_tol=SAME):
        raise FileError(f"{r.case} is not the published run: {measured:.9g} instead of {published:.9g}")
