"""Write and read the file that a solver's process leaves: its motion as plain arrays, and its report.

The file is read by a process that never ran the solver's code, and nothing in it is trusted: sizes and types must be
those of the problem, or the run has crashed.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ..base.confined_paths import ConfinedPath, confine_path
from ..base.files import FileError, parse_json, to_json
from ..base.shapes import Shape, convert_shape
from ..mechanics.state import State, States
from ..mechanics.system import MultibodySystem
from ..mechanics.types import EndCause, Status, Trajectory
from ..results.npz import read_npz, write_scratch_npz
from .contract import CLOCK

# [bytes] of all arrays together: 28 million steps of a body; it bounds the memory of the process that reads
LARGEST = 2**32
POSES = ("r", "R", "v", "Omega")
Words = dict[str, Any]


class SolverReport(Shape, frozen=True, kw_only=True):
    """Hold what a solver's process reports beside the arrays: status, message, costs, counters, events and notes."""

    claimed: Status | None = None  # None: the solver raised
    by: EndCause = EndCause.SOLVER
    message: str = ""
    missing_package: str = ""  # of a refusal
    paper_label: str = ""
    declared_order: float | str = "nan"
    cost: dict[str, float | str] = msgspec.field(default_factory=dict)
    counters: dict[str, int] = msgspec.field(default_factory=dict)
    events: tuple[Words, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Handover:
    """Hold the solver's report and its motion; None where the solver refused or raised."""

    report: SolverReport
    trajectory: Trajectory | None

    @property
    def columns(self) -> dict[str, Any]:
        """Columns of the record that only the solver's process knows: costs, paper label and declared order."""
        cost = {name: float(value) for name, value in self.report.cost.items() if name in COST}
        repeats = {"repeats": int(cost.pop("repeats"))} if "repeats" in cost else {}
        label, order = self.report.paper_label, float(self.report.declared_order)
        return {"paper_label": label, "declared_order": order, **cost, **repeats}


def report_exception(message: str) -> Handover:
    """Return the handover of a process whose solver raised an exception, or whose file cannot be used."""
    return Handover(SolverReport(by=EndCause.EXCEPTION, message=message), None)


COST = (  # columns of the record that ``SolverReport.cost`` gives
    "repeats",
    "cpu_min_s",
    "cpu_q1_s",
    "cpu_median_s",
    "cpu_q3_s",
    "cpu_max_s",
    "cpu_call_s",
    "setup_s",
    "code_s",
    "cpu_import_s",
    "cpu_refuses_s",
)
# [s] of CPU time that a process may take beyond twice what it reports: writing the file takes less
HIDDEN = 1.0


def write_handover(path: Path | ConfinedPath, handed: Handover) -> None:
    """Write report and motion to the file at ``path``, completely or not at all.

    Message, counters, events and notes of the motion replace those of the report; all arrays are written as float64.
    """
    arrays: dict[str, np.ndarray] = {}
    report, trajectory = handed.report, handed.trajectory
    if trajectory is not None:
        report = msgspec.structs.replace(
            report,
            message=str(trajectory.message),
            counters={str(k): int(v) for k, v in trajectory.counters.items()},
            events=tuple(map(dict, trajectory.events)),
            notes=tuple(trajectory.notes),
        )
        arrays = {"t": trajectory.t, **{k: getattr(trajectory.states, k) for k in POSES}}
        arrays |= {f"diag_{name}": values for name, values in trajectory.diagnostics.items()}
        if trajectory.reaction is not None:
            arrays["reaction"] = trajectory.reaction
        if trajectory.returned is not None:
            arrays |= {f"returned_{k}": getattr(trajectory.returned, k) for k in POSES}
    numbers = {k: np.asarray(a, dtype=float) for k, a in arrays.items()}
    write_scratch_npz(path, {"report": np.asarray(to_json(report)), **numbers})


def read_handover(path: Path | ConfinedPath, system: MultibodySystem, spent: float = math.inf) -> Handover | None:
    """Return the handover in the file at ``path``; None if there is no file.

    The process that wrote it took ``spent`` [s] of CPU to solve ``system``: if it reports much less, all of ``spent``
    counts as its cost. Raise FileError if the content is invalid, or reports more CPU time than ``spent``.
    """
    if not confine_path(path).is_own_file():
        return None
    try:
        arrays = dict(read_npz(path, LARGEST))
        report = convert_shape(parse_json(str(arrays.pop("report", "")), "report"), SolverReport, "report")
        _check_cost(report.cost, spent)
        report = _add_hidden_cost(report, spent)
        return Handover(report, _build_trajectory(arrays, report, system) if "t" in arrays else None)
    except ValueError as error:
        raise FileError(f"the arrays that the solver returned cannot be used: {error}") from None


def _add_hidden_cost(report: SolverReport, spent: float) -> SolverReport:
    """Return the report with all ``spent`` [s] of CPU as its cost, and a note, if the process hides most of that time.

    It does if ``spent`` exceeds twice the time by its own clocks by more than ``HIDDEN`` [s]. A report in which a cost
    is missing accounts for no time, since our own code reports them all. Reports of refusals and exceptions are
    returned unchanged.
    """
    whole = not any(math.isnan(float(report.cost.get(name, math.nan))) for name in (*COST, "cpu_inside_s"))
    inside = float(report.cost["cpu_inside_s"]) if whole else 0.0
    moved = report.claimed not in (None, Status.REFUSED)
    if not moved or not math.isfinite(spent) or spent <= 2.0 * inside + HIDDEN:
        return report
    words = (
        f"its process took {spent:.3g} s of CPU time, of which its own clocks account for {inside:.3g} s: all counts"
    )
    columns = ("cpu_min_s", "cpu_q1_s", "cpu_median_s", "cpu_q3_s", "cpu_max_s", "cpu_call_s")
    return msgspec.structs.replace(
        report, cost={**report.cost, **dict.fromkeys(columns, spent)}, notes=(*report.notes, words)
    )


def _check_cost(cost: Mapping[str, float | str], spent: float) -> None:
    """Raise FileError if a time reported by the solver's process is negative or exceeds its CPU time ``spent`` [s].

    The time of import may exceed it, since the parent process may have done that; so may the time of set-up, which
    includes the import and may be wall time.
    """
    for name, value in cost.items():
        most = LARGEST if name in ("cpu_import_s", "setup_s", "repeats", "left_out") else spent + CLOCK
        if not (math.isnan(float(value)) or 0.0 <= float(value) <= most):
            raise FileError(f"{name} = {float(value):.3g} does not fit the {spent:.3g} s of CPU time of its process")


def _build_trajectory(arrays: dict[str, np.ndarray], report: SolverReport, system: MultibodySystem) -> Trajectory:
    """Return the motion in the arrays of a handover file, with what the ``report`` says of it.

    Raise FileError if an array is missing or does not have the shape that ``system`` requires, or is not float64.
    """
    nt, nb = len(np.atleast_1d(arrays["t"])), system.nb
    one = {"r": (nb, 3), "R": (nb, 3, 3), "v": (nb, 3), "Omega": (nb, 3)}
    wanted = {"t": (nt,), **{k: (nt, *shape) for k, shape in one.items()}, "reaction": (nt, system.nrows)}
    wanted |= {f"returned_{k}": shape for k, shape in one.items()}
    for name, a in arrays.items():
        shape = (nt,) if name.startswith("diag_") else wanted.get(name)
        if a.shape != shape or a.dtype != float:
            raise FileError(f"{name} must be float64 of shape {shape} (got {a.dtype} of shape {a.shape})")
    missing = [k for k in POSES if k not in arrays]
    if missing or report.claimed is None:
        raise FileError(f"{', '.join(missing) or 'the status'} is missing")
    back = [arrays[f"returned_{k}"] for k in POSES if f"returned_{k}" in arrays]
    cost = report.cost
    return Trajectory(
        arrays["t"],
        States(*(arrays[k] for k in POSES)),
        report.claimed,
        report.message,
        report.counters,
        arrays.get("reaction"),
        {k[5:]: a for k, a in arrays.items() if k.startswith("diag_")},
        report.events,
        report.notes,
        float(cost.get("cpu_min_s", math.nan)),
        float(cost.get("setup_s", math.nan)),
        State(back[0], back[1], back[2], back[3]) if len(back) == len(POSES) else None,
    )
