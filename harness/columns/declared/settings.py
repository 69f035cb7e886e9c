"""Columns of what was asked for: problem, solver, options, step or tolerance, limits."""

from dataclasses import dataclass

from ..declaring import column
from ..identity import compute_fingerprint


@dataclass(frozen=True, repr=False)
class SettingColumns:
    """The settings of a run."""

    run_id: str = column("content address: problem, parameters, solver, options, step or tolerance, code", "")
    settings_id: str = column("content address without the code: equal between runs of different commits", "")
    case: str = column("the settings in words, unique in a suite: 'heavy_top gc_weak_form dt=0.001'", "")
    suite: str = column("name of the suite", "")
    label: str = column("label of the run in its suite, e.g. 'recommended' or 'as printed'", "", head="Group", order=10)
    problem: str = column("name in problems/", "")
    section: str = column("section of the paper", "")
    problem_parameters: str = column("JSON: those that differ from the defaults", "{}")
    problem_fingerprint: float = column(
        "combination of all numbers of the system, its start and times", of=lambda run: compute_fingerprint(run.problem)
    )
    solver: str = column("name in solvers/", "")
    paper_label: str = column("the paper's name of such a solver", "")
    declared_order: float = column("order in dt that a solver of fixed step declares; NaN if none")
    solver_options: str = column("JSON: those that differ from the defaults", "{}")
    control: str = column("'dt' (fixed step) or 'rtol' (error control)", "")
    dt_s: float = column("fixed step asked for")
    rtol: float = column("relative tolerance asked for")
    max_step_s: float = column("largest step allowed under error control")
    max_steps: int = column("limit on accepted steps, 0 if older than this column", 0)
    t_end_s: float = column("simulated time asked for")
    cpu_limit_s: float = column("limit on the CPU time of the run")
    wall_limit_s: float = column("limit on its wall time, a safety net; in older records there was no other")
    memory_limit_MB: float = column("limit on the memory of the run's process, with all that it starts")
