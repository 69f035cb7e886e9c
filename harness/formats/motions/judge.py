"""Judge a file of any other code like a run: make its record and series, and store them in a results folder."""

import dataclasses
import hashlib
import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...base.confined_paths import ConfinedPath
from ...base.files import FileError
from ...catalogue import codes, registry
from ...catalogue.suites.spec import RunSpec
from ...mechanics.state import States
from ...mechanics.types import Law, Problem, Status, StepControl, Trajectory
from ...reference.computation import find_reference
from ...results import store
from ...results.records import RunRecord, format_notes
from ...results.reproduce import REFEREED
from ...results.series import write_series
from ...results.words import LAWS
from ...run import origin
from ...run.job import Job
from ...run.kept_series import build_series
from ...run.measuring import judge_motion
from . import fmu
from .checks import check_motion
from .columns import Quantities, find_quantities
from .conventions import CHOICES, Reading
from .determinacy import UndeterminedQuantities, find_undetermined, judge_by_determined, measure_uncertainty
from .hints import suggest_reading
from .omissions import check_omissions
from .reading import Motion, Origin, perturb_roundings, read_motion
from .rows import begin_at_start, check_euler_order, check_units, clean_rows
from .tables import READERS, Table, read_table

NAME = re.compile(r"[A-Za-z][\w.+-]*")  # permitted names of a code
WORDS = {"v": "velocities", "R": "orientations", "Omega": "angular velocities"}


@dataclass(frozen=True)
class FileSettings:
    """The user's options on how files are read and recorded."""

    name: str  # name of the code that computed the motion
    reading: Reading = field(default_factory=Reading)
    columns: tuple[str, ...] = ()  # OURS=THEIRS, or our names in the order of columns
    control: StepControl | None = None  # None: the spacing of the rows is used as the step
    tolerance: float | None = None  # of the start, in SI; None: according to the printed digits
    label: str = REFEREED


def choose_settings(first: Path, given: Mapping[str, Any]) -> FileSettings:
    """Return how files are read and recorded, from the command line's options ``given``, by name.

    The name of the code is by default that of the ``first`` file, with the suffix ``_file`` if a solver of the
    catalogue has that name. Raise ValueError for options that cannot be combined.
    """
    reading = Reading(**{name: given[name] for name in CHOICES})
    columns = tuple(c.strip() for c in (given["columns"] or "").split(",") if c.strip())
    if len({"=" in c for c in columns}) > 1:
        raise ValueError("--columns takes OURS=THEIRS, ..., or the names of all columns of a file without a header")
    settings = {k: v for k in ("dt", "rtol") if (v := given.get(k)) is not None}
    if len(settings) > 1:
        raise ValueError("give at most one of --dt and --rtol")
    stem = re.sub(r"[^\w.+-]+", "_", first.stem)
    name = given.get("name") or (f"{stem}_file" if stem in registry.solvers() else stem)
    return FileSettings(name, reading, columns, StepControl(**settings) if settings else None, given["start_tolerance"])


def list_tables(path: Path) -> list[Path]:
    """Return ``path`` if it is no folder, else all tables and FMUs in it; raise FileError if it has none."""
    if not path.is_dir():
        return [path]
    suffixes = (*READERS, fmu.SUFFIX)
    found = sorted(p for p in path.iterdir() if p.suffix.lower() in suffixes and not p.name.startswith("."))
    if not found:
        raise FileError(f"{path} holds no file that ends in {', '.join(suffixes)}")
    return found


def judge_file(
    problem: Problem, path: Path, settings: FileSettings, folder: Path | None, *, several: bool = False
) -> RunRecord:
    """Return the record of the motion in ``path``; raise FileError if it cannot be judged.

    Record and series are also written to the results folder ``folder`` if it is given. With ``several`` the name of the
    file becomes an option of its code, so that files of one code are different runs. A motion that another reading, or
    omitted forces of the mechanism's file, might explain is not called wrong: the first adds a note, the second raises
    FileError.
    """
    if not NAME.fullmatch(settings.name) or settings.name in registry.solvers():
        expected = "the name must be letters, digits and . _ + -, and not that of a solver"
        raise FileError(f"{expected} (got {settings.name!r})")
    table, found, motion, notes = _read_file(problem, path, settings)
    missing = [k for k in ("R", "v", "Omega") if motion.origin[k] is Origin.NONE]
    trajectory = _build_trajectory(problem, motion, path, missing)
    undetermined = find_undetermined(problem, trajectory.states.at(slice(1)), missing)
    uncertainty = _measure_uncertainty(problem, found, settings.reading, motion, trajectory, path, missing)
    notes += _write_notes(motion, missing, undetermined, uncertainty)
    trajectory = dataclasses.replace(trajectory, notes=tuple(notes))

    spec = _make_spec(problem, path, settings, trajectory, several=several)
    job = Job(spec, folder or Path(), REFEREED, _digest_file(table, settings))
    record, m = judge_motion(job, problem, trajectory)
    record, m = judge_by_determined(record, m, undetermined, uncertainty), undetermined.blank_undetermined(m)
    if hints := suggest_reading(problem, found, settings.reading, motion):
        record = dataclasses.replace(record, notes=format_notes([*record.note_lines, *hints]))
    else:
        check_omissions(problem, path, record)
    errors, drifts = (_drop_undetermined(x, undetermined) for x in (record.observable_errors, record.invariant_drifts))
    record = dataclasses.replace(record, observable_errors=errors, invariant_drifts=drifts)
    if folder is None:
        return record
    series = build_series(problem, trajectory, m)
    drawn = {"R": ("frame_q", "end_R"), "v": ("end_v",), "Omega": ("end_Omega",)}
    names = [x for k in missing for x in drawn[k]]  # these would draw the reference as if it were the file
    none = {x: np.full_like(series.arrays[x], math.nan) for x in names}
    series = dataclasses.replace(series, arrays={**series.arrays, **none})
    place = f"series/{job.id}.npz"
    digest = write_series(ConfinedPath(folder) / place, series)
    record = dataclasses.replace(record, series=place, series_sha256=digest, series_rows=len(series["t"]))
    store.list_as_started(folder, record.run_id)
    store.write_record(folder, record)
    return record


def read_trajectory(problem: Problem, path: Path, settings: FileSettings) -> Trajectory:
    """Return the motion in ``path``, read by ``settings``; raise FileError if poses or velocities are missing."""
    _, _, motion, _ = _read_file(problem, path, settings)
    if missing := [WORDS[k] for k in WORDS if motion.origin[k] is Origin.NONE]:
        raise FileError(
            f"{path}: it lacks {' and '.join(missing)}, or they cannot be differenced from rows so far apart"
        )
    return _build_trajectory(problem, motion, path, [])


def _read_file(problem: Problem, path: Path, settings: FileSettings) -> tuple[Table, Quantities, Motion, list[str]]:
    """Return the table in a file, its recognised columns, the motion read from them, and notes for the record.

    An FMU is run. Raise FileError if the file is not a motion of the problem from its start.
    """
    positional = tuple(c for c in settings.columns if "=" not in c)
    renamed = {
        theirs.strip(): ours.strip() for ours, _, theirs in (c.partition("=") for c in settings.columns if "=" in c)
    }
    if path.suffix.lower() == fmu.SUFFIX:
        asked = None if settings.control is None else settings.control.dt
        table = fmu.run_fmu(path, problem.t_end, asked, problem.dt, renamed)
    else:
        table = read_table(path, positional, renamed)
    found = find_quantities(table, problem.system.body_names, renamed)
    check_units(found, settings.reading, path)
    check_euler_order(found, settings.reading, path)
    found = clean_rows(found, settings.reading, path)
    motion = read_motion(found, settings.reading)
    notes = check_motion(problem, found, settings.reading, motion, path, settings.tolerance)
    return table, found, begin_at_start(problem, motion), notes


def open_results(folder: Path) -> Path:
    """Make a results folder, with a stamp like that of a suite, or open an existing one to add to; return it."""
    exists = store.is_results(folder)
    store.create_folder(folder)
    if not exists:
        stamp = origin.describe_environment(folder.name, REFEREED, 1, ())
        (ConfinedPath(folder) / "environment.json").write(json.dumps(stamp, indent=1))
    return folder


def _make_spec(
    problem: Problem, path: Path, settings: FileSettings, trajectory: Trajectory, *, several: bool
) -> RunSpec:
    """Return the specification by which the motion is recorded.

    Its step or tolerance is that of ``settings``, or the median spacing of rows. ``several`` is as in ``judge_file``.
    """
    spacing = float(np.median(np.diff(trajectory.t))) if len(trajectory.t) > 1 else problem.dt
    control = settings.control or StepControl(dt=float(f"{spacing:.6g}"))
    options = {"file": path.stem} if several else {}
    return RunSpec(problem.name, settings.name, control, dict(problem.parameters), options, label=settings.label)


def _digest_file(table: Table, settings: FileSettings) -> str:
    """Return a digest of the file, of how it was read, and of the judging code.

    It replaces the code's digest in the run's id.
    """
    code = codes.digest_code(), codes.read_column_digests().digest
    parts = (*code, table.sha256, repr(settings.reading), repr(settings.columns))
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]


def _build_trajectory(problem: Problem, motion: Motion, path: Path, missing: list[str]) -> Trajectory:
    """Return the motion to judge, up to t_end; quantities in ``missing`` are taken from the reference.

    The first row becomes the exact start, with which it agrees to the printed digits. A motion that stops being finite
    ends before that row and has diverged. Raise FileError if the file lacks the start or the end.
    """
    t = motion.t
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
            f"{t[rows - 1]:.9g} s; give --t-end {t[rows - 1]:.9g} to judge it up to there, or --time for other units"
        )
    t = np.array(t[:rows])
    if status is Status.SUCCESS:
        t[-1] = problem.t_end  # the time as printed may differ in its last digit
    if missing:
        exact = _evaluate_reference(problem, t, path, missing)
        parts |= {k: getattr(exact, k) for k in missing}
    for k, a in parts.items():  # the start was found to agree with the exact one to the printed digits
        parts[k] = np.concatenate((getattr(problem.initial, k)[None], a[1:rows]))
    return Trajectory(t, States(**parts), status, message, {"rows": rows - 1}, cpu_time=math.nan)


def _measure_uncertainty(
    problem: Problem, found: Quantities, how: Reading, motion: Motion, given: Trajectory, path: Path, missing: list[str]
) -> Mapping[tuple[Law, str], float]:
    """Return how far each law moves where rates are differenced or digits are few; empty for a motion cut short.

    ``given`` is the motion as read from ``found`` with ``how``; the file is read again with other splines, and with its
    last digits changed.
    """
    if given.status is not Status.SUCCESS:
        return {}

    def read(table: Quantities, degree: int) -> list[Trajectory]:
        """Return the motion read by splines of ``degree``, in a list; empty if it then lacks other quantities."""
        other = begin_at_start(problem, read_motion(table, how, degree))
        alike = all((getattr(other, k) is None) == (getattr(motion, k) is None) for k in ("R", "v", "Omega"))
        return [_build_trajectory(problem, other, path, missing)] if alike else []

    spacing = read(found, 3) if Origin.DIFFERENCED in motion.origin.values() else []
    printed = any(np.any(a > 0.0) for a in found.resolution.values())
    digits = read(perturb_roundings(found), 5) if printed else []
    return measure_uncertainty(problem, given, spacing, digits) if spacing or digits else {}


def _write_notes(
    motion: Motion, missing: list[str], known: UndeterminedQuantities, uncertainty: Mapping[tuple[Law, str], float]
) -> list[str]:
    """Return notes on what was differenced, what is missing and not judged, and how uncertain the energy is."""
    notes = []
    differenced = [WORDS[k] for k in ("v", "Omega") if motion.origin[k] is Origin.DIFFERENCED]
    if differenced:
        notes.append(f"{' and '.join(differenced)}: not in the file, differenced from its poses")
        drift = uncertainty.get((Law.ENERGY, ""), math.nan)
        if Law.ENERGY not in known.open_laws and not math.isnan(drift):
            words = "the energy is that of differenced velocities, not of the code's"
            notes.append(f"{words}: spacing and digits of the file leave it uncertain by {drift:.2g} J")
    elif uncertainty.get((Law.ENERGY, ""), 0.0) > 0.0 and Law.ENERGY not in known.open_laws:
        notes.append(f"the digits of the file leave the energy uncertain by {uncertainty[Law.ENERGY, '']:.2g} J")
    if missing:
        open_laws = [words for law, words in LAWS.items() if law in known.open_laws]
        lacks = " and ".join(WORDS[k] for k in missing)
        notes.append(f"{lacks}: not in the file; not judged without: {', '.join((lacks, *open_laws))}")
    return notes


def _drop_undetermined(extents: str, undetermined: UndeterminedQuantities) -> str:
    """Return ``extents``, a JSON column of errors or drifts, without the names that the file does not determine."""
    return json.dumps({k: x for k, x in json.loads(extents).items() if k not in undetermined.open_names})


def _evaluate_reference(problem: Problem, t: np.ndarray, path: Path, missing: list[str]) -> States:
    """Return the reference's states at times ``t`` [s], for the quantities ``missing`` in the file.

    Raise FileError if the reference is missing or ends before the last time.
    """
    reference = find_reference(problem)
    if reference is None or reference.horizon < t[-1] * (1.0 - 1e-9):
        lacks = " and ".join(WORDS[k] for k in missing)
        horizon = 0.0 if reference is None else reference.horizon
        raise FileError(
            f"{path}: it lacks {lacks}, or they cannot be differenced from rows so far apart; without them a motion is "
            f"judged by the reference alone, which is known to {horizon:g} s (asked: {t[-1]:g} s)"
        )
    return reference.states(np.minimum(t, reference.horizon))
