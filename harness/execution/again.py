"""Finished runs solved again: for a comparison, or for steps that their results left out.

A run repeats to the bit where code and platform are its own. Both are compared before anything is solved, and the steps
with the digest that the results keep of them.
"""

import dataclasses
import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from ..files import FileError
from ..places import Place
from ..results import codes, environment, store
from ..results.provenance import describe_differences, find_differences, same_platform, stamp_of
from ..results.records import RunRecord
from ..results.reproduce import control_of
from ..results.series import Series
from ..sandbox.trial import make_problem
from ..suites.spec import RunSpec, make_spec
from ..suites.suite import Suite
from .runner import Request

ENOUGH = 10.0  # times the CPU time that the run took: a limit meets nothing but another machine


def rebuild_spec(record: RunRecord) -> RunSpec:
    """The spec of a record's run, or ValueError where this checkout would run something else."""
    try:
        problem = make_problem(record.problem, json.loads(record.problem_parameters))
        control = control_of(record)
        limits = {"cpu_limit": control.pop("cpu_limit", math.nan), "memory": record.memory_limit_MB}
        spec = make_spec(problem, record.solver, json.loads(record.solver_options), control, **limits)
    except ValueError as error:
        raise ValueError(f"{record.case} cannot be run here: {error}") from None
    if spec.settings_id != record.settings_id:
        raise ValueError(f"{record.case} has other settings in this checkout: defaults have changed")
    return spec


def solve_again(
    folder: Path, records: Sequence[RunRecord], place: Path, jobs: int, run: Callable[[Request], object],
    plugins: tuple[str, ...] = (), *, lossless: bool = True,
) -> dict[str, Series]:  # fmt: skip
    """Return every step of runs in ``folder`` by run_id, solved again into the new folder ``place`` by ``run``.

    FileError before anything is solved where the code or the platform is not the runs' own, and afterwards where steps
    have other bits. ``lossless``: with every state too. Plugins of the runs must be loaded.
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
    """A run in messages."""
    return f"run {record.run_id[:8]} ({record.case})"


def _check_origin(folder: Path, record: RunRecord, plugins: tuple[str, ...]) -> None:
    """FileError unless the code and the platform here are those of the run."""
    own = codes.code_of(record.problem, record.solver, plugins)
    if own != record.code:
        where = f"; check out {record.commit[:12]}" if record.commit else ""
        raise FileError(
            f"{name_run(record)} keeps not every step, and cannot be solved again: it is of code {record.code}, "
            f"here is {own}{where}, or run its suite again"
        )
    there, here = _read_stamp(folder, record), environment.stamp("", "", 1, plugins)
    if not same_platform(there, here):
        found = [d for d in find_differences(there, here) if d.what not in ("suite", "plugins")]
        raise FileError(
            f"{name_run(record)} keeps not every step, and cannot be solved again to the bit here: "
            f"{describe_differences(found)}"
        )


def _read_stamp(folder: Path, record: RunRecord) -> Mapping[str, object]:
    """The environment of the run: a resumed folder has several."""
    name = f"environment.{record.environment}.json"
    return stamp_of(folder, name if (Place(folder) / name).is_own_file() else "environment.json")


def limit_steps(spec: RunSpec, record: RunRecord) -> RunSpec:
    """Allow as many steps as the run took, and time for them: a clock that ended it would end it elsewhere."""
    cut = record.t_reached_s < record.t_end_s and 0 < record.steps < spec.control.max_steps
    control = dataclasses.replace(spec.control, max_steps=record.steps) if cut and _by_clock(record) else spec.control
    limit = max(spec.cpu_limit, ENOUGH * record.cpu_process_s) if record.cpu_process_s > 0.0 else spec.cpu_limit
    return dataclasses.replace(spec, control=control, cpu_limit=limit)


def _by_clock(record: RunRecord) -> bool:
    return record.ended_by != "solver" or record.claimed == "stalled"


def _read_checked(folder: Path, record: RunRecord, place: Path, again: RunRecord | None) -> Series:
    kept = store.series_of(folder, record, poses=False)
    found = store.series_of(place, again) if again is not None else None
    if found is None or kept is None:
        raise FileError(f"{name_run(record)} left no steps when solved again")
    if found.steps_sha256 != kept.steps_sha256:
        raise FileError(f"{name_run(record)} was solved again, and its steps have other bits than those of the results")
    return found
