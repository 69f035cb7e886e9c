"""Run a solver on one mechanism in many presentations, and find whether it keeps the symmetries that it must."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ...catalogue import registry
from ...catalogue.suites.spec import RunSpec, make_spec
from ...catalogue.trial import make_problem
from ...mechanics.types.presentations import PRESENTATIONS
from ...results.findings import Finding, count_holding
from ...results.judgements.runs import Symmetry
from ...results.records import RunRecord
from ..referee.certificates.symmetries import check_symmetries

Values = Mapping[str, Any]
LOOP: Values = {"rows": 1, "columns": 1, "t_end": 0.2}  # a grid of three bars on revolute joints
TREE: Values = {"bodies": 3, "loops": 0, "springs": 0, "loads": 0, "t_end": 0.2}  # without redundant rows
PRESENTED: tuple[Values, ...] = tuple({p.name: p.tried} for p in PRESENTATIONS)
EXPECTED = "frames, mirror, units, numbering, time"


def make_trial_run(
    solver: str,
    problem: str,
    given: Values,
    control: Values,
    label: str,
    cpu_limit: float,
    options: Values | None = None,
) -> RunSpec:
    """Return the run of a solver on a problem with parameters ``given``, of at most ``cpu_limit`` [s] of CPU time.

    ``control`` is its step or tolerance, ``label`` the group of runs that it belongs to, such as ``ladder``;
    ``options`` are those of the solver that are not defaults.
    """
    return make_spec(make_problem(problem, given), solver, options, control, label=label, cpu_limit=cpu_limit)


def plan_symmetries(solver: str, problem: str, parameters: Mapping[str, Any], cpu_limit: float) -> list[RunSpec]:
    """Return runs of a problem unchanged, finer, perturbed and in each presentation, with a limit on CPU time [s].

    For fixed steps, one more run has a tenth of the solver's tolerance, if it has one. ``parameters`` are those of the
    problem.
    """
    entry = registry.solvers()[solver]
    base = {"dt": 0.01} if entry.control == "dt" else {"rtol": 1e-6}
    finer = {"dt": 0.005} if entry.control == "dt" else {"rtol": 1e-7}

    def present(change: Mapping[str, Any], control: Mapping[str, float], **options: float) -> RunSpec:
        """Return the run of the problem with a ``change`` of its parameters, a step or tolerance, and options."""
        return make_trial_run(solver, problem, {**parameters, **change}, control, "symmetries", cpu_limit, options)

    out = [present({}, control) for control in (base, finer)]
    if entry.control == "dt" and (tolerance := entry.parameters.get("tolerance")):
        out.append(present({}, base, tolerance=float(f"{0.1 * tolerance[0]:.6g}")))  # needed to compute the bound
    return out + [present(change, base) for change in ({"perturb": 1e-8}, *PRESENTED)]


def assess_symmetries(folder: Path, runs: Sequence[RunRecord], none: str) -> Iterator[Finding]:
    """Yield a finding for each symmetry that is broken or could not be tested, and one on how many hold.

    ``folder`` has the series of ``runs``. ``none`` is the reason stated if there is no symmetry to count.
    """
    found = check_symmetries(folder, runs)
    yield from (s.as_finding() for s in found if s.verdict in ("broken", "failed"))
    yield _count_symmetries(found, {r.settings_id: r.message for r in runs}, none)


def _count_symmetries(found: Sequence[Symmetry], messages: Mapping[str, str], none: str = "") -> Finding:
    """Return the finding on how many symmetries hold, of those for which the solver refused no run.

    ``messages`` are those of the runs by settings_id, which say why a run was refused; ``none`` is the reason stated if
    nothing was found.
    """
    taken = [s for s in found if s.verdict != "refused"]
    refused = Counter((s.problem, s.message or messages.get(s.settings_ids[0], "")) for s in found if s not in taken)
    words = "; ".join(f"{n} refused on {problem}: {why}" for (problem, why), n in refused.items())
    kept = sum(s.verdict == "holds" for s in taken)
    return count_holding("symmetries", kept, len(taken), words if found else none, EXPECTED)
