"""Engines behind the protocol: their model is ours, a planted fault is refused, loops and motions are exact."""

import importlib.util
import json
import sys
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from mbsbench import Joint, RigidBody, State, assemble
from mbsbench.harness.catalogue.registry import engines, make_problem, make_solver
from mbsbench.harness.mechanics.forces import TorsionSpring
from mbsbench.harness.mechanics.motion import constraint
from mbsbench.harness.mechanics.system import GROUND
from mbsbench.harness.mechanics.types import Status, StepControl
from mbsbench.solvers.engines.drake import INTEGRATORS
from mbsbench.solvers.engines.export import process, protocol
from mbsbench.solvers.engines.export.model_check import measure_differences
from mbsbench.tests.factories import solve_run

from ..runs import error, orders
from .systems import PROBLEMS
from .test_engines import PACKAGES, without_springs
from .test_single_precision import WHEELS


@dataclass(frozen=True)
class Served:
    """Facts that the tests know of an engine."""

    package: str  # as it is imported
    wheel: str
    gap: float  # [m] of the grid's joints at dt = 5e-3
    loops: dict[str, Any]  # options that hold loops
    unlike: tuple[str, ...] = ()  # of ``PROBLEMS``: what it has no joints or springs for
    refused: str = "only; the system has"


GUIDED = ("guided", "tilting", "rolling")
DART_LACKS = ("closed_chain", "sliding", "sprung", "driven", "jointed_otherwise", *GUIDED)
SERVED = {
    "drake": Served(
        "pydrake",
        "drake",
        1e-5,
        {"integrator": "sap"},
        ("sliding", "driven", *GUIDED),
        "constraints to the world crash it",
    ),
    "dart": Served("dartpy", "dartpy", 1e-10, {}, DART_LACKS),
    "opensim": Served("opensim", "opensim", 1e-5, {}, ("tilting", "rolling")),
}
ADAPTIVE = {"drake_adaptive", "opensim"}


def control(name: str, dt: float = 1e-3) -> StepControl:
    return StepControl(rtol=1e-7) if name in ADAPTIVE else StepControl(dt=dt)


def needs(name):
    served = SERVED[name]
    absent = importlib.util.find_spec(served.package) is None and process.find_environment(name) is None
    return pytest.mark.skipif(absent, reason=f"{served.wheel} is an optional extra: make test-engines")


@pytest.fixture(params=[pytest.param(name, marks=needs(name)) for name in SERVED])
def engine(request):
    """An installed engine's name."""
    return request.param


def test_every_engine_is_tested():
    assert {*SERVED, *PACKAGES, *WHEELS, "drake_adaptive", "cvode"} == set(engines())


@pytest.mark.parametrize("name", SERVED)
def test_without_the_package_it_refuses_with_the_remedy(name, monkeypatch):
    """A refusal is a result, in one line."""
    monkeypatch.setitem(sys.modules, SERVED[name].package, None)
    monkeypatch.setattr(protocol, "find_environment", lambda inside: None)
    said = make_solver(name).refuses(make_problem("heavy_top"), control(name))
    assert said == f"{SERVED[name].wheel} is not installed: {type(make_solver(name)).remedy}"


@pytest.mark.parametrize("name", PROBLEMS)
def test_its_model_is_ours(engine, name):
    """Mass matrix, forces, energies, accelerations and freedom, to rounding."""
    problem, solver = PROBLEMS[name](), make_solver(engine, SERVED[engine].loops)
    if name in SERVED[engine].unlike:
        said = solver.refuses(problem, control(engine))
        assert said is not None and (SERVED[engine].refused if name == "sliding" else "only; the system has") in said
        if name in ("driven", "jointed_otherwise", *GUIDED) or (engine, name) == ("dart", "sliding"):
            return
        problem = problem if name == "sliding" else without_springs(problem)
    found = measure_differences(problem, protocol.Model(solver, problem, control(engine)).describe_start())
    assert max(found.values()) < 1e-10, found


@pytest.mark.parametrize("name", [pytest.param(name, marks=needs(name)) for name in ("drake", "opensim")])
def test_torsional_springs_and_dampers_are_the_engines_own(name):
    """About the hinge of a moving body, away from rest, in both orders of ends."""
    plain = PROBLEMS["sprung"]()
    axis, across = (0.3, 0.5, 0.8), (0.8, 0.0, -0.3)
    spring = TorsionSpring(0, across, GROUND, axis, across, stiffness=30.0, damping=2.0, rest_angle=0.4)
    bodies = [RigidBody(m, J) for m, J in zip(plain.system.mass[:1], plain.system.inertia[:1], strict=True)]
    joint = Joint(0, (-0.3, 0.0, 0.1), GROUND, (0.0, 0.0, 0.0), axis, axis)
    system = assemble(bodies, [joint], (0.0, -9.81, 0.0), torsions=[spring])
    start = State(*(getattr(plain.initial, a)[:1] for a in ("r", "R", "v", "Omega")))
    turning = 3.0 * np.array(axis) / np.linalg.norm(axis)
    start = replace(start, v=np.cross(turning, start.r), Omega=turning[None])
    problem = replace(plain, system=system, initial=start, t_end=0.2)
    assert make_solver(name).refuses(problem, control(name)) is None
    exact = make_solver("rkmk_dop853").solve(problem, StepControl(rtol=1e-11)).states.r[-1]
    assert np.max(np.abs(make_solver(name).solve(problem, control(name)).states.r[-1] - exact)) < 1e-6


@pytest.mark.parametrize("wrong", [lambda J: J * (1.0 + 1e-8), lambda J: J + 1e-8 * np.ones((3, 3))])
def test_a_planted_inertia_is_refused(engine, wrong, monkeypatch):
    """The fault is in what the engine is given, not in the problem: there is no race."""
    right = protocol.flatten_tree

    def planted(tree, system, start):
        return right(tree, replace(system, inertia=wrong(system.inertia)), start)

    monkeypatch.setattr(protocol, "flatten_tree", planted)
    t = make_solver(engine, SERVED[engine].loops).solve(PROBLEMS["perturbed_chain"](), control(engine))
    assert t.status is Status.REFUSED and t.counters["steps"] == 0
    assert "is not that of chain: its" in t.message and "differs by" in t.message


def test_loops_stay_closed(engine):
    problem = PROBLEMS["grid"]()
    t = make_solver(engine, SERVED[engine].loops).solve(problem, control(engine, 5e-3))
    assert t.status is Status.SUCCESS, t.message
    assert np.max(np.abs(constraint(problem.system, t.states))) < SERVED[engine].gap
    assert t.t[-1] == problem.t_end and t.counters["steps"] == len(t.t) - 1


@needs("opensim")
def test_a_drive_that_opensim_cannot_differentiate_is_refused():
    """By name; each of its parts alone moves as the exact kinematics do."""
    solver = make_solver("opensim")
    said = solver.refuses(make_problem("driven_slider_crank"), control("opensim"))
    assert said is not None and "the drive 'drive' is a polynomial and a sine" in said
    p = make_problem("driven_slider_crank", {"wobble": 0.0, "t_end": 0.2})
    t = solver.solve(p, control("opensim"))
    assert t.status is Status.SUCCESS, t.message
    np.testing.assert_allclose(t.states.r, p.reference().states(t.t).r, atol=1e-8)
    np.testing.assert_allclose(t.states.v, p.reference().states(t.t).v, atol=1e-6)


SPATIAL = "spherical_pendulum", {"omega_x": 5.0, "omega_z": 3.0, "t_end": 0.5}  # on a ball, where theta' is not v


@pytest.mark.parametrize(
    "name", ["sprung", "sliding", "loaded_in_time", "driven", "guided", "free_body", "slider_crank"]
)
def test_poses_and_velocities_are_those_of_another_method(engine, name):
    """Free bodies, springs, slides, loads, drives: a quarter of the step leaves a quarter of the error."""
    made = name in PROBLEMS and name != "slider_crank"
    problem = PROBLEMS[name]() if made else make_problem(name, {"rotation": (0.3, -0.5, 0.7), "t_end": 0.3})
    if name in SERVED[engine].unlike:
        if name != "sprung":
            pytest.skip(f"{engine} does not take it")
        problem = without_springs(problem)
    problem = replace(problem, t_end=0.2)
    exact = make_solver("rkmk_dop853").solve(problem, StepControl(rtol=1e-11)).states[-1]
    errors = []
    for fine in (1.0, 0.25):
        t = make_solver(engine, SERVED[engine].loops).solve(
            problem, StepControl(rtol=1e-7 * fine**3) if engine in ADAPTIVE else StepControl(dt=1e-3 * fine)
        )
        assert t.status is Status.SUCCESS, t.message
        off = [np.max(np.abs(getattr(t.states[-1], a) - getattr(exact, a))) for a in ("r", "R", "v", "Omega")]
        errors.append(max(off))
    assert errors[1] < max(0.3 * errors[0], 1e-9)


GRID = "four_bar_grid", {"rows": 2, "columns": 2, "t_end": 0.5}
ORDERS = [
    *(("drake", {"integrator": i}, SPATIAL, 0.01, order) for i, order in INTEGRATORS.items() if i != "radau1"),
    ("drake", {"integrator": "sap"}, GRID, 5e-3, 1.0),
    ("dart", {}, SPATIAL, 0.01, 1.0),
    ("dart", {}, ("chain", {"t_end": 0.4}), 2e-3, 1.0),
]


@pytest.mark.parametrize(
    ("name", "options", "problem", "dt", "order"), [pytest.param(*row, marks=needs(row[0])) for row in ORDERS]
)
def test_the_order_is_the_declared_one(name, options, problem, dt, order):
    p = make_problem(*problem)
    assert make_solver(name, options).order == order
    assert orders([error(p, solve_run(p, dt / 2**k, name, **options)) for k in range(3)])[-1] == pytest.approx(
        order, abs=0.2
    )


TOLERANCES = [
    pytest.param("drake_adaptive", {}, SPATIAL, 1.0, marks=needs("drake")),
    pytest.param("drake_adaptive", {"integrator": "cenic"}, SPATIAL, 0.5, marks=needs("drake")),
    *(pytest.param("opensim", {}, p, 0.8, marks=needs("opensim")) for p in (SPATIAL, GRID)),
]


@pytest.mark.parametrize(("name", "options", "problem", "power"), TOLERANCES)
def test_the_error_falls_with_the_tolerance(name, options, problem, power):
    """Error control of order p on the error a step of order p + 1: between its power p / (p + 1) and 1.

    CENIC's estimate is of second order and its steps of first: its error falls with the root of its accuracy.
    """
    p = make_problem(*problem)
    runs = [make_solver(name, options).solve(p, StepControl(rtol=rtol)) for rtol in (1e-4, 1e-6)]
    errors = [np.max(np.abs(t.states.r - p.reference().states(t.t).r)) for t in runs]
    assert all(t.status is Status.SUCCESS for t in runs) and errors[0] < 1e-2
    assert np.log(errors[0] / errors[1]) / np.log(100.0) == pytest.approx(power, abs=0.2)


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("drake", {}, "its continuous plant ignores constraints"),
        ("drake", {"integrator": "tamsi"}, "TAMSI has no"),
        ("drake_adaptive", {"integrator": "cenic"}, "CENIC has no"),
    ],
)
@needs("drake")
def test_loops_are_refused_where_drake_does_not_hold_them(name, options, words, monkeypatch):
    """In words; and without these the model check finds what Drake does not say of a continuous plant."""
    problem, solver = PROBLEMS["grid"](), make_solver(name, options)
    assert words in solver.refuses(problem, control(name))
    monkeypatch.setattr(type(solver), "_refuse_options", lambda *_: None)
    said = solver.refuses(problem, control(name))
    assert said is not None and ("differs by" in said or "does not take the model" in said)


@needs("drake")
@pytest.mark.parametrize("dt", [1e-3, 7e-4])
def test_every_step_is_one_row(dt):
    """Drake adds up its time: after thousands of steps it needs one of rounding's length to the end."""
    t = make_solver("drake").solve(make_problem("heavy_top", {"t_end": 2.0}), StepControl(dt=dt))
    assert t.status is Status.SUCCESS and t.counters["steps"] == np.ceil(2.0 / dt - 1e-9)
    np.testing.assert_allclose(np.diff(t.t)[:-1], dt, rtol=1e-9)


@needs("dart")
def test_settings_of_one_run_are_not_those_of_the_next():
    """DART's error reduction is one number for all constraints of a process."""
    p, ends = make_problem("chain", {"t_end": 0.2}), []
    for options in ({"settings": "default"}, {"error_reduction": 0.01}, {}, {"settings": "default"}):
        ends.append(make_solver("dart", options).solve(p, StepControl(dt=2e-3)).states.r[-1])
    np.testing.assert_array_equal(ends[0], ends[1])
    np.testing.assert_array_equal(ends[0], ends[3])
    assert np.max(np.abs(ends[2] - ends[0])) > 0.0


def test_stretches_join(engine, monkeypatch):
    """Whatever the length of stretches, the motion is the same."""
    problem = make_problem("heavy_top", {"t_end": 0.1})
    whole = make_solver(engine).solve(problem, control(engine))
    march = protocol.march
    monkeypatch.setattr(protocol, "march", lambda *a, **k: march(*a, **{**k, "stretch": 7}))
    parts = make_solver(engine).solve(problem, control(engine))
    np.testing.assert_array_equal(parts.t, whole.t)
    np.testing.assert_allclose(parts.states.r, whole.states.r, atol=1e-9)


def test_what_engines_are_given_is_plain():
    """JSON there and back changes nothing."""
    problem = PROBLEMS["sliding"]()
    tree = protocol.build_spanning_tree(problem.system, problem.initial)
    text = json.dumps(protocol.flatten_tree(tree, problem.system, problem.initial), default=lambda a: a.tolist())
    assert json.dumps(json.loads(text)) == text
