"""Test problem requirements: a documented, consistent start, sound measures, and a true exact motion.

The problem's code runs in a process of its own: one that hangs or crashes fails its requirement.
"""

import json
import traceback
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

import msgspec

from ...base.code_meter import CODE_LIMIT
from ...base.forked_process import ForkedProcess
from ...catalogue import registry
from ...mechanics.consistency import InconsistentStart
from ...results.findings import Finding, leave_open, make_failure
from . import laws
from .laws import Subject
from .requirements import Requirement, assign_findings

LIMIT = 400.0  # [s] for all requirements on a problem; computing a reference takes 60 s and more
MEMORY = 2000.0  # [MB]


def check_problem(name: str, plugins: Sequence[str] = ()) -> list[Finding]:
    """Return a finding for every requirement on the problem ``name``, whose code runs in another process.

    ``plugins`` are the files that this process loads first. If it ends early, the next requirement fails with how it
    ended, and those after it as not reached.
    """
    ended = ForkedProcess(
        lambda send: _measure_requirements(name, plugins, send), limit=LIMIT, memory=MEMORY, code=CODE_LIMIT
    ).wait()
    found = [msgspec.convert(json.loads(line), Finding) for line in ended.sent.splitlines()]
    words = ended.describe_limit(LIMIT, MEMORY) or f"its process {ended.words} here"
    for _ in REQUIREMENTS[len(found) :]:
        found.append(make_failure(words))
        words = "not reached: an earlier test ended the process"
    return assign_findings(name, REQUIREMENTS, found)


def locate_error(error: BaseException, plugins: Sequence[str]) -> str:
    """Return the last line of a plugin's file in the exception's traceback, as `` (fourbar.py:31)``; empty if none."""
    own = {str(Path(p).resolve()) for p in plugins}
    frames = [f for f in traceback.extract_tb(error.__traceback__) if str(Path(f.filename).resolve()) in own]
    return f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""


def _measure_requirements(name: str, plugins: Sequence[str], send: Callable[[str], None]) -> None:
    """Measure all requirements on the problem ``name``, and send the finding on each as JSON as soon as it is known.

    If the problem cannot be made, the first requirement fails with the error, and the others are left open.
    """
    for plugin in plugins:
        registry.load_plugin(plugin)
    subject, complaint = Subject(name), ""
    try:
        subject.problem  # noqa: B018 - made once, so that its error counts once, not per requirement
    except InconsistentStart:
        pass  # measured by the requirement on the start
    except Exception as error:  # raised by the problem's own code
        complaint = _describe_error(error, plugins)
    for k, requirement in enumerate(REQUIREMENTS):
        if complaint:
            remedy = "correct what raised it; nothing else can be tested before"
            found = leave_open("not tested: it cannot be made") if k else make_failure(complaint, remedy=remedy)
        else:
            found = _measure_requirement(requirement, subject, plugins)
        send(json.dumps(asdict(found)))


def _measure_requirement(requirement: Requirement, subject: Subject, plugins: Sequence[str]) -> Finding:
    """Return the finding on one requirement; an error that the problem's code raises fails it.

    An inconsistent start fails the requirement on the start alone, and leaves others open. Requirements on the
    reference are open without one.
    """
    try:
        if requirement.needs_reference and subject.reference is None:
            return leave_open("no reference")
        return requirement.measure(subject)
    except InconsistentStart as error:  # reported once, by the requirement on the start
        return (
            make_failure(str(error))
            if laws.check_initial_state(subject).holds
            else leave_open("its start is inconsistent")
        )
    except Exception as error:  # raised by the problem's own code
        words = _describe_error(error, plugins)
        return make_failure(words, cause=words)


def _describe_error(error: Exception, plugins: Sequence[str]) -> str:
    """Return type, message and place of an error of the problem's code on one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}{locate_error(error, plugins)}"


REQUIREMENTS = (
    Requirement(
        "it can be made and is documented",
        "list and reports show these texts; a number without a source cannot be checked",
        "a docstring, a meaning (and unit) in each Parameter, source and name in Problem",
        laws.check_documentation,
    ),
    Requirement(
        "its start is consistent",
        "every solver starts there: an inconsistent start changes the energy before the first step",
        "make phi and phi_dot vanish: v_C = omega x (C - joint); mbsbench.project helps",
        laws.check_initial_state,
    ),
    Requirement(
        "its times are valid", "suites use them unchanged", "give t_end >= dt > 0 [s], both finite", laws.check_times
    ),
    Requirement(
        "its energy is finite and has a scale",
        "energy drift is the first metric, compared with this scale",
        "check masses, inertias, gravity and springs",
        laws.check_energy_scale,
    ),
    Requirement(
        "observables and invariants are numbers over time",
        "they are evaluated on whole motions: shape (nt,), each value from the state of its time only",
        "index the body, keep the time axis: lambda s: s.r[:, 0, 2]",
        laws.check_scalars,
    ),
    Requirement(
        "making it twice gives the same problem",
        "results are compared bit for bit and stored by parameters",
        "seed what is random, by a parameter",
        laws.check_repeatability,
    ),
    Requirement(
        "it can be turned",
        "yaw and rotation turn every problem; observables refer to the home frame",
        "let measures use only the states they are given",
        laws.check_turned,
    ),
    Requirement(
        "its reference states its error",
        "smaller errors of solvers are meaningless and are not shown",
        "error(t): a bound [m] for each time, below a thousandth of the size within the horizon",
        laws.check_stated_error,
        needs_reference=True,
    ),
    Requirement(
        "its reference begins at the start",
        "also for a perturbed start, which reference_from receives",
        "take r, R, v, Omega from the State passed in, or return None",
        laws.check_reference_start,
        needs_reference=True,
    ),
    Requirement(
        "its reference is the motion computed independently",
        "two other formulations, which only know bodies, joints and forces, compute the motion until they agree",
        "one of the two is of another system: compare masses, inertias, gravity and the start",
        laws.check_computed_reference,
        needs_reference=True,
    ),
    Requirement(
        "its reference keeps the joints closed",
        "R must be rotations and phi zero, to its stated error",
        "compare with the positions of the joints' points, body by body",
        laws.check_joints,
        needs_reference=True,
    ),
    Requirement(
        "velocities of its reference are those of its poses",
        "errors of velocity and energy use them",
        "dr/dt = v in space, dR/dt = R hat(Omega) with Omega in the body",
        laws.check_rates,
        needs_reference=True,
    ),
    Requirement(
        "its reference keeps the energy",
        "no damper acts: T + V is constant along any true motion",
        "check the sign of gravity, and that inertias are about C, not about the joint",
        laws.check_energy,
        needs_reference=True,
    ),
    Requirement(
        "its invariants are constant along the motion",
        "solvers are judged by their drift",
        "drop what the exact motion does not keep, or correct the formula",
        laws.check_invariants,
    ),
    Requirement(
        "its reference obeys Newton and Euler",
        "m a - f must be joint forces, else it is the motion of another system",
        "look for a missing term: gyroscopic torque, gravity, Steiner",
        laws.check_newton_euler,
        needs_reference=True,
    ),
)
