"""The runs that a figure asks for, found in the results; one that is not there stays in the list, to be named."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from ...harness.results.series import Series
from ...harness.types import StepControl
from ..model.results import Run, format_name
from ..plots.lines import all_lines, describe_end, shared_options
from .catalogue import Pick

ROLES = {
    "gc_weak_form": "ODE-GC", "gc_augmented_lagrangian": "ODE-GC (AL)", "rk45_strong_form": "ODE-45",
    "ida_index1": "DAE-FI", "ndf_index1": "DAE-SE", "ida_index3": "index 3",
}  # fmt: skip
MISSING = "not in these results"
DIRECTIONS = {"a": "c_R = a/(a·a)", "translation": "c_R = (e_R, 0)", "mass": "c_R by mass"}  # Eq. (31)


class Asked(Protocol):
    """A run of the suite ``paper``; reports read no suites, the caller hands them over."""

    @property
    def problem(self) -> str: ...
    @property
    def parameters(self) -> Mapping[str, Any]: ...
    @property
    def solver(self) -> str: ...
    @property
    def options(self) -> Mapping[str, Any]: ...
    @property
    def control(self) -> StepControl: ...
    @property
    def label(self) -> str: ...
    @property
    def settings_id(self) -> str: ...
    @property
    def case(self) -> str: ...


@dataclass(frozen=True)
class Line:
    """A run asked for and the one found, with its series; None where the results have none with these settings."""

    asked: Asked
    run: Run | None
    settings: str  # step or tolerance, and in what else it differs from the figure's other runs of the solver
    series: Series | None = None
    dash: int = 0

    @property
    def role(self) -> str:
        """Whose part in the paper the solver plays: ODE-GC by the label of its record, which has the gauge."""
        role = ROLES[self.asked.solver]
        return (role.startswith("ODE-GC") and self.run and self.run.record.paper_label) or role

    @property
    def words(self) -> str:
        """The paper's name, ours, the settings, and how it ended or that the run or its series is missing."""
        words = f"{self.role} ({self.asked.solver}), {self.settings}"
        if self.run is None:
            return f"{words}: {MISSING}"
        if self.series is None and self.run.record.series:
            return f"{words}: its series cannot be read"
        return f"{words}{describe_end(self.run)}"


def choose(picks: Iterable[Pick], specs: Iterable[Asked], runs: Iterable[Run],
           read: Callable[[Run], Series | None] = lambda run: None) -> list[Line]:  # fmt: skip
    """In the order of the picks, with the series that ``read`` gives; of two runs with the same settings the later."""
    known = list(specs)
    asked = [s for p in picks for s in select_runs(p, known)]
    there = {r.record.settings_id: r for r in sorted(runs, key=lambda r: r.record.finished)}
    found = [(s, there.get(s.settings_id)) for s in asked]
    drawn = [run for _, run in found if run]
    dash = {k.run.record.run_id: k.dash for k in all_lines(drawn, shared_options(drawn))}
    series = {run.record.run_id: read(run) for run in drawn}
    lines = [(s, run, _settings(s, asked), run.record.run_id if run else "") for s, run in found]
    return [Line(s, run, words, series.get(name), dash.get(name, 0)) for s, run, words, name in lines]


def select_runs(pick: Pick, specs: Sequence[Asked]) -> list[Asked]:
    """The runs of the suite that ``pick`` means, solver by solver."""
    there = [s for s in specs if s.label == pick.label and format_name(s.problem, s.parameters) == pick.variant]
    out: list[Asked] = []
    for solver in pick.solvers:
        own = [s for s in there if s.solver == solver]
        out += own if pick.every else own and [min(own, key=lambda s: s.control.rtol or -(s.control.dt or 0.0))]
    return out


def _settings(asked: Asked, others: Sequence[Asked]) -> str:
    c = asked.control
    own = [asked, *(s for s in others if s.solver == asked.solver)]
    words = zip(*((s.label, DIRECTIONS[s.options.get("direction", "a")]) for s in own), strict=True)
    differs = [of[0] for of in words if len(set(of)) > 1]
    return ", ".join([f"dt = {c.dt:g} s" if c.dt is not None else f"rtol = {c.rtol:g}", *differs])
