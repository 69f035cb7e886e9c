"""A file of any other code judged like a run: its record, its series, its place beside others in a results folder."""

import dataclasses
import hashlib
import json
import math
import re
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..catalogue import registry
from ..execution.job import Job
from ..execution.measuring import judged
from ..files import FileError
from ..mechanics.state import States
from ..places import Place
from ..reference.computed import reference_of
from ..results import environment, store
from ..results.records import RunRecord
from ..results.reproduce import REFEREED
from ..suites.spec import RunSpec
from ..types import Problem, Status, StepControl, Trajectory
from .checks import check, check_times
from .columns import found_in
from .reading import Motion, Origin, Reading, read_motion
from .tables import READERS, Table, read_table

NAME = re.compile(r"[A-Za-z][\w.+-]*")
RATES = ("phi_dot", "eq81", "energy_", "invariant_drifts")
BLANK = {  # columns that say nothing where a quantity is the reference's, by how they begin
    "v": (*RATES, "velocity_error"),
    "R": (*RATES, "phi_", "orientation_", "orthogonality", "angular_velocity"),
    "Omega": (*RATES, "angular_velocity"),
}
WORDS = {"v": "velocities", "R": "orientations", "Omega": "angular velocities"}


@dataclass(frozen=True)
class Given:
    """What the user says about files."""

    name: str  # of the code
    reading: Reading = field(default_factory=Reading)
    columns: tuple[str, ...] = ()  # OURS=THEIRS, or ours in order
    control: StepControl | None = None  # None: the spacing of the rows stands for the step
    tolerance: float | None = None  # of the start, in SI; None: the digits printed
    label: str = REFEREED


def files_of(path: Path) -> list[Path]:
    """The file, or all tables in a folder."""
    if not path.is_dir():
        return [path]
    found = sorted(p for p in path.iterdir() if p.suffix.lower() in READERS and not p.name.startswith("."))
    if not found:
        raise FileError(f"{path} holds no file that ends in {', '.join(READERS)}")
    return found


def refereed(problem: Problem, path: Path, given: Given, folder: Path | None, *, several: bool = False) -> RunRecord:
    """The record of ``path``; with its series in ``folder``, if one is given. FileError where it cannot be judged."""
    if not NAME.fullmatch(given.name) or given.name in registry.solvers():
        raise FileError(f"the name must be letters, digits and . _ + -, and not that of a solver (got {given.name!r})")
    positional = tuple(c for c in given.columns if "=" not in c)
    table = read_table(path, positional)
    pairs = (c.partition("=") for c in given.columns if "=" in c)
    found = found_in(table, problem.system.body_names, {theirs: ours for ours, _, theirs in pairs})
    check_times(problem, found, given.reading, path)
    motion = read_motion(found, given.reading)
    notes = check(problem, found, given.reading, motion, path, given.tolerance)
    trajectory, blank = _trajectory(problem, motion, path, notes)
    job = Job(_spec(problem, path, given, trajectory, several=several), Path(), REFEREED, _digest(table, given))
    if folder is not None:
        job = dataclasses.replace(job, folder=folder)
        record = dataclasses.replace(judged(job, problem, trajectory), **blank)
        store.write_record(folder, record)
        return record
    with tempfile.TemporaryDirectory() as place:
        (Path(place) / "series").mkdir()
        record = judged(dataclasses.replace(job, folder=Path(place)), problem, trajectory)
    return dataclasses.replace(record, series="", series_sha256="", series_rows=0, **blank)


def results_folder(folder: Path) -> Path:
    """A results folder to add to; a new one is stamped like that of a suite."""
    known = store.is_results(folder)
    store.create(folder)
    if not known:
        stamp = environment.stamp(folder.name, REFEREED, 1, ())
        (Place(folder) / "environment.json").write(json.dumps(stamp, indent=1))
    return folder


def _spec(problem: Problem, path: Path, given: Given, trajectory: Trajectory, *, several: bool) -> RunSpec:
    spacing = float(np.median(np.diff(trajectory.t))) if len(trajectory.t) > 1 else problem.dt
    control = given.control or StepControl(dt=float(f"{spacing:.6g}"))
    options = {"file": path.stem} if several else {}
    return RunSpec(problem.name, given.name, control, dict(problem.parameters), options, label=given.label)


def _digest(table: Table, given: Given) -> str:
    """Of the file, how it was read, and the code that judges it: the part of the code in a run's address."""
    parts = (environment.code_digest(), table.sha256, repr(given.reading), repr(given.columns))
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]


def _trajectory(problem: Problem, motion: Motion, path: Path, notes: list[str]) -> tuple[Trajectory, dict[str, Any]]:
    """The motion to judge, up to t_end, and the columns that say nothing about it."""
    t, blank = motion.t, dict[str, Any]()
    parts = {k: getattr(motion, k) for k in ("r", "R", "v", "Omega")}
    slack = 1e-6 * problem.t_end
    rows = int(np.sum(t <= problem.t_end + slack))
    finite = np.ones(rows, dtype=bool)
    for a in filter(lambda a: a is not None, parts.values()):
        finite &= np.isfinite(a[:rows]).reshape(rows, -1).all(axis=1)
    status, message = Status.SUCCESS, "the file reaches the end"
    if not np.all(finite):
        rows = int(np.argmax(~finite))
        status, message = Status.DIVERGED, f"row {rows + 1} of the file is not finite"
    elif rows == 0 or t[0] != 0.0:
        raise FileError(f"{path}: its first row must be the start, t = 0 (got t = {t[0]:g} s); mbsbench export has it")
    elif t[rows - 1] < problem.t_end - slack:
        raise FileError(
            f"{path}: no row at the end of {problem.name}, t = {problem.t_end:g} s: the last before it is at "
            f"{t[rows - 1]:.9g} s; give --t-end {t[rows - 1]:.9g} to judge it up to there"
        )
    t = np.array(t[:rows])
    if status is Status.SUCCESS:
        t[-1] = problem.t_end  # printed
    missing = [k for k in ("R", "v", "Omega") if motion.origin[k] is Origin.NONE]
    differenced = [WORDS[k] for k in ("v", "Omega") if motion.origin[k] is Origin.DIFFERENCED]
    if differenced:
        notes.append(f"{' and '.join(differenced)}: not in the file, differenced from its poses")
    if missing:
        exact = _exact(problem, t, path, missing)
        for k in missing:
            parts[k] = getattr(exact, k)
            blank |= {c.name: c.default for c in dataclasses.fields(RunRecord) if c.name.startswith(BLANK[k])}
        notes.append(f"{' and '.join(WORDS[k] for k in missing)}: not in the file, not judged")
    for k, a in parts.items():  # the start was found to be the exact one, to the digits printed
        parts[k] = np.concatenate((getattr(problem.initial, k)[None], a[1:rows]))
    counters = {"rows": rows - 1}
    return Trajectory(t, States(**parts), status, message, counters, notes=tuple(notes), cpu_time=math.nan), blank


def _exact(problem: Problem, t: np.ndarray, path: Path, missing: list[str]) -> States:
    """The reference in place of what the file lacks."""
    reference = reference_of(problem)
    if reference is None or reference.horizon < t[-1] * (1.0 - 1e-9):
        lacks = " and ".join(WORDS[k] for k in missing)
        horizon = 0.0 if reference is None else reference.horizon
        raise FileError(
            f"{path}: it lacks {lacks}, or they cannot be differenced from rows so far apart; without them a motion is "
            f"judged by the reference alone, which is known to {horizon:g} s (asked: {t[-1]:g} s)"
        )
    return reference.states(np.minimum(t, reference.horizon))
