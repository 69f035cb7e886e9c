"""The file that a solver's process hands over: its motion as plain arrays, and what it says about them.

The file is read by a process that never ran the solver's code, and nothing in it is believed: sizes and types are
those of the problem, or the run has crashed.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ..files import FileError, parse_json, to_json
from ..mechanics.state import State, States
from ..mechanics.system import MultibodySystem
from ..places import Place, place_of
from ..results.npz import read_npz, write_npz
from ..shapes import Shape, convert_shape
from ..types import EndedBy, Status, Trajectory
from .contract import CLOCK

LARGEST = 2**32  # [bytes] of all arrays together
POSES = ("r", "R", "v", "Omega")
Words = dict[str, Any]


class SolverReport(Shape, frozen=True, kw_only=True):
    """All that a solver's process reports beside the arrays."""

    claimed: Status | None = None  # None: it raised
    by: EndedBy = EndedBy.SOLVER
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
    """The solver's report and the motion; no motion where the solver refused or raised."""

    report: SolverReport
    trajectory: Trajectory | None

    @property
    def columns(self) -> dict[str, Any]:
        """Columns of the record that only the solver's process knows."""
        cost = {name: float(value) for name, value in self.report.cost.items() if name in COST}
        repeats = {"repeats": int(cost.pop("repeats"))} if "repeats" in cost else {}
        label, order = self.report.paper_label, float(self.report.declared_order)
        return {"paper_label": label, "declared_order": order, **cost, **repeats}


COST = (
    "repeats", "cpu_min_s", "cpu_q1_s", "cpu_median_s", "cpu_q3_s", "cpu_max_s", "cpu_call_s", "setup_s", "code_s",
    "cpu_import_s", "cpu_refuses_s",
)  # fmt: skip
HIDDEN = 1.0  # [s] of CPU, beside as much again as is accounted for: handing over takes less


def write(path: Path | Place, handed: Handover) -> None:
    """Whole or not at all; not compressed, for it is read at once and removed."""
    arrays: dict[str, np.ndarray] = {}
    report, trajectory = handed.report, handed.trajectory
    if trajectory is not None:
        report = msgspec.structs.replace(
            report, message=str(trajectory.message), counters={str(k): int(v) for k, v in trajectory.counters.items()},
            events=tuple(map(dict, trajectory.events)), notes=tuple(trajectory.notes),
        )  # fmt: skip
        arrays = {"t": trajectory.t, **{k: getattr(trajectory.states, k) for k in POSES}}
        arrays |= {f"diag_{name}": values for name, values in trajectory.diagnostics.items()}
        if trajectory.reaction is not None:
            arrays["reaction"] = trajectory.reaction
        if trajectory.returned is not None:
            arrays |= {f"returned_{k}": getattr(trajectory.returned, k) for k in POSES}
    numbers = {k: np.asarray(a, dtype=float) for k, a in arrays.items()}
    write_npz(path, {"report": np.asarray(to_json(report)), **numbers}, compressed=False)


def read(path: Path | Place, system: MultibodySystem, spent: float = math.inf) -> Handover | None:
    """The motion handed over for ``system`` by a process that took ``spent`` [s] of CPU; None if nothing was.

    FileError if it is not what it must be.
    """
    if not place_of(path).is_own_file():
        return None
    try:
        arrays = dict(read_npz(path, LARGEST))
        report = convert_shape(parse_json(str(arrays.pop("report", "")), "report"), SolverReport, "report")
        _check_cost(report.cost, spent)
        report = _with_hidden_cost(report, spent)
        return Handover(report, _trajectory(arrays, report, system) if "t" in arrays else None)
    except ValueError as error:
        raise FileError(f"what the solver handed over cannot be used: {error}") from None


def _with_hidden_cost(report: SolverReport, spent: float) -> SolverReport:
    """All the process took as its cost, and a note, where its own clocks account for less than half of that.

    A report of a motion that leaves out any cost accounts for nothing: ours says all.
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
    """Raise FileError where a time that the solver's process has measured is below zero, or above all that it took.

    The import may be the work of the process that forked it; set-up contains the import and may be wall time.
    """
    for name, value in cost.items():
        most = LARGEST if name in ("cpu_import_s", "setup_s", "repeats", "left_out") else spent + CLOCK
        if not (math.isnan(float(value)) or 0.0 <= float(value) <= most):
            raise FileError(f"{name} = {float(value):.3g} does not fit the {spent:.3g} s of CPU time of its process")


def _trajectory(arrays: dict[str, np.ndarray], report: SolverReport, system: MultibodySystem) -> Trajectory:
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
        arrays["t"], States(*(arrays[k] for k in POSES)), report.claimed, report.message, report.counters,
        arrays.get("reaction"), {k[5:]: a for k, a in arrays.items() if k.startswith("diag_")}, report.events,
        report.notes, float(cost.get("cpu_min_s", math.nan)), float(cost.get("setup_s", math.nan)),
        State(back[0], back[1], back[2], back[3]) if len(back) == len(POSES) else None,
    )  # fmt: skip
