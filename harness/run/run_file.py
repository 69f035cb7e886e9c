"""Write and read one run as one NPZ file: its trajectory with every accepted step, its measurements, and its record."""

import dataclasses
import json
from pathlib import Path

import numpy as np

from ..base.files import FileError
from ..judge.metrics.measure import measure
from ..judge.metrics.reactions import find_largest_joint_force
from ..mechanics.state import States
from ..mechanics.types import Status, Trajectory
from ..results.npz import read_npz, write_npz
from ..results.records import RunRecord, format_record, parse_record_json
from .measuring import Outcome

# [bytes] of all arrays, as in ``handover``: 28 million steps of a body; it bounds the memory of a reader
LARGEST = 2**32
POSES = ("r", "R", "v", "Omega")
SUMMARY = (  # columns of the record that the file has too
    "status",
    "claimed",
    "message",
    "ended_by",
    "ended_limit_s",
    "exit_code",
    "signal",
    "counters",
    "notes",
    "t_end_s",
    "t_reached_s",
    "steps",
    "energy_drift_max_J",
    "energy_scale_J",
    "phi_max",
    "phi_dot_max",
    "position_error_max_m",
    "orientation_error_max_rad",
    "motion_error_max_m",
    "length_scale_m",
    "compared_to_s",
    "accurate_until_s",
    "accurate_until_1pct_s",
    "accurate_until_0p1pct_s",
    "setup_s",
)


def write_run(path: Path, outcome: Outcome) -> RunRecord:
    """Write the file of a run, completely or not at all; return the record with its path and number of rows.

    A run without a motion (refused, or ended before its first step) gets the start as its only row, or no bodies if its
    problem cannot be measured. The arrays are listed in ``docs/results-format.md``.
    """
    problem, record = outcome.problem, outcome.record
    trajectory, m = outcome.trajectory, outcome.measured
    if problem is None:
        return write_without_motion(path, record)
    if trajectory is None or m is None:
        trajectory = Trajectory(np.zeros(1), States.one(problem.initial), Status(record.status), record.message, {})
        try:
            m = measure(problem, trajectory)
        except Exception:  # a problem that cannot be measured, as the record says
            return write_without_motion(path, record)
    s = trajectory.states
    arrays = {
        "t": m.t,
        **{name: getattr(s, name) for name in POSES},
        "energy": m.energy,
        "phi_norm": m.phi_norm,
        "phi_dot_norm": m.phi_dot_norm,
        "dt": np.diff(m.t),
        **_list_scalars(record),
        "events": np.asarray(json.dumps(list(trajectory.events))),
        **{f"obs_{name}": values for name, values in m.observables.items()},
        **{f"diag_{name}": np.asarray(values, dtype=float) for name, values in trajectory.diagnostics.items()},
    }
    if trajectory.reaction is not None:
        reaction = np.asarray(trajectory.reaction, dtype=float)
        arrays["obs_joint_force"] = find_largest_joint_force(problem.system, reaction)
        arrays["reaction"] = reaction  # (nt, nrows), conjugate to phi: N for point rows, N m for axis rows
    write_npz(path, arrays)
    return dataclasses.replace(record, series=str(path), series_rows=len(m.t))


def write_without_motion(path: Path, record: RunRecord) -> RunRecord:
    """Write the file of a run without a measured motion, with one row and no bodies; return its record."""
    nothing, one = np.full(1, np.nan), (1, 0, 3)
    arrays = {
        "t": np.zeros(1),
        "r": np.zeros(one),
        "R": np.zeros((1, 0, 3, 3)),
        "v": np.zeros(one),
        "Omega": np.zeros(one),
        "energy": nothing,
        "phi_norm": nothing,
        "phi_dot_norm": nothing,
        "dt": np.zeros(0),
        **_list_scalars(record),
        "events": np.asarray("[]"),
    }
    write_npz(path, arrays)
    return dataclasses.replace(record, series=str(path), series_rows=1)


def _list_scalars(record: RunRecord) -> dict[str, np.ndarray]:
    """Return the columns ``SUMMARY`` of the record as arrays of one value, and the whole record as JSON."""
    named = {name: np.asarray(getattr(record, name)) for name in SUMMARY}
    cpu = {"reasons": np.asarray(record.wrong_because), "cpu_s": np.asarray(record.cpu_min_s)}
    return {**named, **cpu, "record": np.asarray(format_record(record))}


def read_run(path: Path) -> tuple[RunRecord, Trajectory]:
    """Return the record and the trajectory in the NPZ file of a run.

    Raise ValueError, with a message of one line, if it is no such file or of another version.
    """
    try:
        arrays = read_npz(path, LARGEST)
        record = parse_record_json(str(arrays["record"]))
        trajectory = Trajectory(
            arrays["t"],
            States(*(arrays[name] for name in POSES)),
            Status(record.claimed or record.status),
            record.message,
            dict(record.counts),
            arrays.get("reaction"),
            {name[5:]: values for name, values in arrays.items() if name.startswith("diag_")},
            tuple(json.loads(str(arrays["events"]))),
            record.note_lines,
            record.cpu_median_s,
            record.setup_s,
        )
    except FileError as error:
        raise ValueError(f"{path} was written by another version of mbsbench ({error}); solve it again") from None
    except KeyError as error:
        raise ValueError(f"{path} is not a file written by solve (it has no {error})") from None
    except ValueError as error:
        raise ValueError(f"cannot read {path}: {error}") from None
    return record, trajectory
