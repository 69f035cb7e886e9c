"""Solve finished runs again: for a comparison, or for steps that their results omitted.

A run repeats bit for bit if code and platform are unchanged. Both are compared before anything is solved; afterwards
the digest of the new steps is compared with the one in the results.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from ..base.confined_paths import ConfinedPath
from ..base.files import FileError
from ..catalogue import codes
from ..catalogue.suites.spec import RunSpec, make_spec
from ..catalogue.suites.suite import Suite
from ..catalogue.trial import make_problem
from ..results import store
from ..results.provenance import describe_differences, find_differences, is_same_platform, read_environment
from ..results.records import RunRecord
from ..results.reproduce import list_control
from ..results.series import Series
from . import origin
from .runner import Request

ENOUGH = 10.0  # times the CPU time that the run took: a limit that only a much slower machine reaches


def rebuild_spec(record: RunRecord) -> RunSpec:
    """Return the spec that describes a record's run, with its limits.

    Raise ValueError if it is invalid here, or if defaults have changed so that it has another ``settings_id``.
    """
    try:
        problem = make_problem(record.problem, record.parameters)
        control = list_control(record)
        limits = {"cpu_limit": control.pop("cpu_limit", math.nan), "memory": record.memory_limit_MB}
        spec = make_spec(problem, record.solver, record.options, control, **limits)
    except ValueError as error:
        raise ValueError(f"{record.case} cannot be run here: {error}") from None
    if spec.settings_id != record.settings_id:
        raise ValueError(f"{record.case} has other settings in this checkout: defaults have changed")
    return spec


def solve_every_step(
    folder: Path,
    records: Sequence[RunRecord],
    place: Path,
    jobs: int,
    run: Callable[[Request], object],
    plugins: tuple[str, ...] = (),
    *,
    lossless: bool = True,
) -> dict[str, Series]:
    """Solve the runs ``records`` of ``folder`` again into the new folder ``place``; return their series by run_id.

    The series have every step, and with ``lossless`` every state. ``run`` executes the request, ``jobs`` runs at a
    time; plugins of the runs must be loaded. Raise FileError before anything is solved if the code or the platform is
    not that of the runs, and afterwards if steps have other bits.
    """
    for record in records:
        _check_origin(folder, record, plugins)
    specs = {r.run_id: limit_steps(rebuild_spec(r), r) for r in records}
    different = {s.settings_id: s for s in specs.values()}
    suite = Suite("again", "finished runs solved again", tuple(different.values()), "", plugins)
    run(Request(suite, place, jobs, lossless=lossless))
    found = {r.settings_id: r for r in store.load(place, check_series=False).records}
    return {r.run_id: _read_checked(folder, r, place, found.get(specs[r.run_id].settings_id)) for r in records}


def name_run(record: RunRecord) -> str:
    """Return the name of a run for messages: the beginning of its run_id, and its case."""
    return f"run {record.run_id[:8]} ({record.case})"


def _check_origin(folder: Path, record: RunRecord, plugins: tuple[str, ...]) -> None:
    """Raise FileError unless code, plugins and platform are those of the run, so that it repeats bit for bit."""
    own = codes.digest_run_code(record.problem, record.solver, plugins)
    if own != record.code:
        where = f"; check out {record.commit[:12]}" if record.commit else ""
        raise FileError(
            f"{name_run(record)} does not store every step and cannot be solved again: it is of code {record.code}, "
            f"this is {own}{where}, or run its suite again"
        )
    there, here = _read_stamp(folder, record), origin.describe_environment("", "", 1, plugins)
    if not is_same_platform(there, here):
        found = [d for d in find_differences(there, here) if d.quantity not in ("suite", "plugins")]
        raise FileError(
            f"{name_run(record)} does not store every step and cannot be solved again bit for bit here: "
            f"{describe_differences(found)}"
        )


def _read_stamp(folder: Path, record: RunRecord) -> Mapping[str, object]:
    """Read the stamp of a run's environment: its own file, as a resumed folder has several, or ``environment.json``."""
    name = f"environment.{record.environment}.json"
    return read_environment(folder, name if (ConfinedPath(folder) / name).is_own_file() else "environment.json")


def limit_steps(spec: RunSpec, record: RunRecord) -> RunSpec:
    """Return ``spec`` with limits under which it repeats the motion of ``record`` step by step.

    If the run was cut short, the limit on steps is the number it took, since a clock would now end it at another step.
    The limit on CPU time is at least ``ENOUGH`` times what the run took, if that is known.
    """
    cut = record.t_reached_s < record.t_end_s and 0 < record.steps < spec.control.max_steps
    control = (
        dataclasses.replace(spec.control, max_steps=record.steps) if cut and _was_cut_short(record) else spec.control
    )
    limit = max(spec.cpu_limit, ENOUGH * record.cpu_process_s) if record.cpu_process_s > 0.0 else spec.cpu_limit
    return dataclasses.replace(spec, control=control, cpu_limit=limit)


def _was_cut_short(record: RunRecord) -> bool:
    """Return whether a limit or an outside cause ended the run, rather than its own motion."""
    return record.ended_by != "solver" or record.claimed == "stalled"


def _read_checked(folder: Path, record: RunRecord, place: Path, again: RunRecord | None) -> Series:
    """Return the series of a repeated run, whose record in the folder ``place`` is ``again``.

    Raise FileError if that is None or has no series, or if any bit of its steps differs from those of ``record`` in
    ``folder``.
    """
    kept = store.read_run_series(folder, record, poses=False)
    found = store.read_run_series(place, again) if again is not None else None
    if found is None or kept is None:
        raise FileError(f"{name_run(record)} left no steps when solved again")
    if found.steps_sha256 != kept.steps_sha256:
        raise FileError(f"{name_run(record)} was solved again, and its steps are not bit for bit those of the results")
    return found
