"""Find the true motion nearest to a computed one, and the modified energy of a fixed-step method (``shadow``)."""

import argparse
import tempfile
from pathlib import Path
from typing import Any

from ...harness.catalogue.trial import make_problem
from ...harness.formats.motions.judge import choose_settings, read_trajectory
from ...harness.lab.shadow.findings import describe_energy, describe_shadow, summarise_nearest, summarise_shadow
from ...harness.lab.shadow.modified_energy import find_modified_energy
from ...harness.lab.shadow.shadow import find_shadow
from ...harness.mechanics.types import Problem, Trajectory
from ...harness.results import store
from ...harness.results.findings import state_finding
from ...harness.results.records import RunRecord
from ...harness.results.shadows import store_nearest
from ...harness.run.costs import describe_command
from ...harness.run.full_series import rebuild_spec
from ...harness.run.run_file import read_run
from ...harness.run.solve_file import solve_to_file
from ..arguments import UsageError, find_results, load_plugins, load_problem
from ..findings import print_findings
from ..progress import announce_suite
from ..show import find_run
from ..terminal import make_console, make_error_console, plural


def run(arguments: argparse.Namespace) -> int:
    """Find the shadow of a motion and its modified energy and print the findings, with --html also as a page.

    For a run of a results folder they are kept there, too. Return 0 if a shadow is found over the whole time within a
    tenth of the reach, else 1.
    """
    title, problem, trajectory, run = _read_motion(arguments)
    steps, bodies = len(trajectory.t) - 1, problem.system.nb
    time_needed = describe_command("shadow", steps * bodies)
    announce_suite(
        f"{plural(steps, 'step')}, bodies: {bodies}: {time_needed}, more where no motion is near", make_error_console()
    )
    shadow = find_shadow(problem, trajectory, arguments.t_end)
    found = describe_shadow(shadow)
    good = all(f.holds for f in found)
    try:
        modified = find_modified_energy(problem, trajectory)
        found += describe_energy(modified)
    except ValueError as error:
        modified = None
        found.append(state_finding("modified energy", f"not computed: {error}"))
    if run is not None:
        store_nearest(*run, summarise_nearest(shadow, modified))
    print_findings(found, *([] if arguments.json else [title]), json=arguments.json)
    if arguments.html:
        from ...reports.lab.shadow import write_page

        write_page(arguments.html, title, found, problem.system.body_names, shadow)
        if not arguments.json:
            make_console().print(f"page: {arguments.html}")
    return 0 if good else 1


Motion = tuple[str, Problem, Trajectory, tuple[Path, RunRecord] | None]  # title, ..., results folder and record


def _read_motion(arguments: argparse.Namespace) -> Motion:
    """Read the motion that is given as a file, or solve a run of a results folder again, whose poses are thinned.

    Return a title, the problem, the trajectory, and the pair of results folder and record, None for a file.
    """
    path = Path(arguments.motion)
    if arguments.problem is not None:
        name, parameters, _ = load_problem(arguments)
        problem = make_problem(name, parameters)
        settings = choose_settings(path, vars(arguments))
        return f"{name} {path.name}", problem, read_trajectory(problem, path, settings), None
    load_plugins(arguments.plugin)
    if path.suffix == ".npz":
        return *_read_run(path), None
    if path.is_file():
        raise UsageError(f"{path} does not name its problem; give it with --problem")
    folder = find_results(arguments.results)
    record = find_run(store.load(folder, check_series=False).records, arguments.motion, folder)
    with tempfile.TemporaryDirectory() as place:
        again = Path(place) / "run.npz"
        solve_to_file(rebuild_spec(record), again, None)
        return *_read_run(again), (folder, record)


def _read_run(path: Path) -> tuple[str, Problem, Trajectory]:
    """Return case, problem and trajectory of the run in an NPZ file."""
    record, trajectory = read_run(path)
    return record.case, make_problem(record.problem, record.parameters), trajectory


def find_nearest(problem: Problem, path: Path) -> dict[str, Any]:
    """Return words and numbers on the true motion nearest to the one in an NPZ file, by name.

    If none is found, there is only ``words``: the reason.
    """
    try:
        return summarise_shadow(find_shadow(problem, read_run(path)[1]))
    except ValueError as error:
        return {"words": str(error)}
