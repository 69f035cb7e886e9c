"""Run a solver on one mechanism in many presentations, and find whether it keeps the symmetries that it must."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ...catalogue import registry
from ...catalogue.suites.spec import RunSpec, make_spec
from ...catalogue.trial import make_problem
from ...mechanics.types.presentations import PRESENTATIONS
from ...results.findings import Finding, state_finding
from ...results.judgements.runs import Symmetry
from ...results.records import RunRecord
from ..referee.certificates.symmetries import check_symmetries

LOOP: Mapping[str, Any] = {"rows": 1, "columns": 1, "t_end": 0.2}  # a grid of three bars on revolute joints
TREE: Mapping[str, Any] = {"bodies": 3, "loops": 0, "springs": 0, "loads": 0, "t_end": 0.2}  # without redundant rows
PRESENTED: tuple[Mapping[str, Any], ...] = tuple({p.name: p.tried} for p in PRESENTATIONS)
EXPECTED = "frames, mirror, units, numbering, time"


def plan_symmetries(solver: str, problem: str, parameters: Mapping[str, Any], wall: float) -> list[RunSpec]:
    """Return runs of a problem unchanged, finer, perturbed and in each presentation, of at most ``wall`` [s] of CPU."""
    entry = registry.solvers()[solver]
    base = {"dt": 0.01} if entry.control == "dt" else {"rtol": 1e-6}
    finer = {"dt": 0.005} if entry.control == "dt" else {"rtol": 1e-7}

    def spec(change: Mapping[str, Any], control: Mapping[str, float], options: Mapping[str, Any]) -> RunSpec:
        """Return the run of the changed problem with this step or tolerance and these options."""
        made = make_problem(problem, {**parameters, **change})
        return make_spec(made, solver, options, control, label="symmetries", cpu_limit=wall)

    out = [spec({}, control, {}) for control in (base, finer)]
    if entry.control == "dt" and (tolerance := entry.parameters.get("tolerance")):
        out.append(spec({}, base, {"tolerance": float(f"{0.1 * tolerance[0]:.6g}")}))  # needed to compute the bound
    return out + [spec(change, base, {}) for change in ({"perturb": 1e-8}, *PRESENTED)]


def assess_symmetries(folder: Path, runs: Sequence[RunRecord], none: str) -> Iterator[Finding]:
    """Yield findings on broken symmetries and on how many hold; ``none`` is what a finding says if none was checked."""
    found = check_symmetries(folder, runs)
    if not found:
        yield state_finding("symmetries", none, EXPECTED)
        return
    yield from (s.as_finding() for s in found if s.verdict in ("broken", "failed"))
    yield _count_symmetries(found, {r.settings_id: r.message for r in runs})


def _count_symmetries(found: Sequence[Symmetry], messages: Mapping[str, str]) -> Finding:
    """Return the finding on how many symmetries hold, of those on which the solver did not refuse a run.

    It is met if all hold, else open, since a broken symmetry has its own finding. ``messages`` are those of the runs by
    settings_id, which say why a run was refused.
    """
    taken = [s for s in found if s.verdict != "refused"]
    refused = Counter((s.problem, s.message or messages.get(s.settings_ids[0], "")) for s in found if s not in taken)
    words = "; ".join(f"{n} refused on {problem}: {why}" for (problem, why), n in refused.items())
    if not taken:
        return state_finding("symmetries", f"not determined: {words}", EXPECTED)
    kept = sum(s.verdict == "holds" for s in taken)
    counted = f"{kept} of {len(taken)} hold{words and f'; {words}'}"
    good = True if kept == len(taken) else None
    return state_finding("symmetries", counted, EXPECTED, good=good)
