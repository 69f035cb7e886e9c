"""Every engine with a model of its own: that model is ours, a planted fault is refused, loops and motions are exact."""

import dataclasses
import importlib
import importlib.util
import sys
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.lab.fuzz.cases import read_case
from mbsbench.harness.lab.fuzz.drawing import draw_mechanism
from mbsbench.harness.mechanics.motion import constraint, constraint_rate, energy
from mbsbench.harness.mechanics.state import States
from mbsbench.harness.mechanics.types import Status, StepControl
from mbsbench.harness.results.environment import ROOT
from mbsbench.solvers.engines import mujoco, pinocchio
from mbsbench.solvers.engines.export import exudyn_rows
from mbsbench.solvers.engines.export.engine import import_package
from mbsbench.solvers.engines.export.model_check import measure_differences
from mbsbench.tests.factories import solve_run

from ..runs import error, orders
from .systems import PROBLEMS

PACKAGES = {"mujoco": "mujoco", "exudyn": "exudyn", "pinocchio": "pin"}  # by solver, as pip calls them
SPRINGLESS = {"pinocchio"}
UNLIKE = {
    "pinocchio": ("driven", "loaded", "loaded_in_time", "guided", "tilting", "rolling"),
    "mujoco": ("driven", "loaded_in_time", "guided", "tilting", "rolling"),
    "exudyn": ("driven",),
}
NAMED = {  # what a refusal names
    "driven": "driven position (way), driven angle (turn)",
    "loaded": "a load (on body 0, on body 1)",
    "loaded_in_time": "a load that varies (on body 0, on body 1)",
    "guided": "point on line (joint 0), distance (joint 2)",
    "rolling": "rolling disc (contact)",
    "tilting": "point on plane (joint 0), normal axes (joint 1)",
}
CONTROL = StepControl(dt=1e-3)


def needs(*names):
    missing = [PACKAGES[name] for name in names if importlib.util.find_spec(name) is None]
    return pytest.mark.skipif(bool(missing), reason=f"{missing} is an optional extra: make test-engines")


def module_of(name):
    return importlib.import_module(type(make_solver(name)).__module__)


@pytest.fixture(params=[pytest.param(name, marks=needs(name)) for name in PACKAGES])
def engine(request):
    """An installed engine's name."""
    return request.param


@pytest.mark.parametrize("name", PACKAGES)
def test_without_the_package_it_refuses_with_the_remedy(name, monkeypatch):
    """A refusal is a result, in one line."""
    monkeypatch.setitem(sys.modules, name, None)
    for said in (
        make_solver(name).refuses(make_problem("heavy_top"), CONTROL),
        make_solver(name).solve(make_problem("heavy_top"), CONTROL).message,
    ):
        assert said == f"{PACKAGES[name]} is not installed: pip install 'mbsbench[engines]'"


def without_springs(problem):
    arrays = {
        f.name: getattr(problem.system, f.name)[:0]
        for f in dataclasses.fields(problem.system)
        if f.name.startswith("spring_")
    }
    return dataclasses.replace(problem, system=dataclasses.replace(problem.system, **arrays))


@pytest.mark.parametrize("name", PROBLEMS)
def test_its_model_is_ours(engine, name):
    """Mass matrix, forces, energies, accelerations and freedom, to rounding."""
    problem = PROBLEMS[name]()
    if name in UNLIKE[engine]:
        said = make_solver(engine).refuses(problem, CONTROL)
        assert said is not None and f"the system has {NAMED[name]}" in said
        return
    if engine in SPRINGLESS and len(problem.system.spring_k):
        said = make_solver(engine).refuses(problem, CONTROL)
        assert said is not None and "only; the system has springs" in said
        problem = without_springs(problem)
    found = measure_differences(
        problem, module_of(engine).Model(make_solver(engine), problem, CONTROL).describe_start()
    )
    assert max(found.values()) < 1e-10, found


@pytest.mark.parametrize("wrong", [lambda J: J * (1.0 + 1e-8), lambda J: J + 1e-8 * np.ones((3, 3))])
def test_a_planted_inertia_is_refused(engine, wrong, monkeypatch):
    """The fault is in what the engine is given, not in the problem: there is no race."""
    module, problem = module_of(engine), PROBLEMS["perturbed_chain"]()
    right = module.Model

    def planted(options, problem, control):
        system = dataclasses.replace(problem.system, inertia=wrong(problem.system.inertia))
        return right(options, dataclasses.replace(problem, system=system), control)

    monkeypatch.setattr(module, "Model", planted)
    t = make_solver(engine).solve(problem, CONTROL)
    assert t.status is Status.REFUSED and t.counters["steps"] == 0
    assert "is not that of chain: its" in t.message and "differs by" in t.message


@pytest.mark.parametrize(
    ("name", "parameters", "dt"),
    [
        ("spherical_pendulum", {"omega_z": 3.0, "t_end": 1.0}, 2e-3),
        ("heavy_top", {"t_end": 0.2}, 5e-4),
        ("chain", {"t_end": 0.4}, 1e-3),
        ("four_bar_grid", {"rows": 2, "columns": 2, "t_end": 0.5}, 5e-3),
    ],
)
def test_it_moves_like_the_exact_motion(engine, name, parameters, dt):
    """Errors fall at least fourfold with half the step; a step that is cut at the end changes nothing of that."""
    problem = make_problem(name, parameters)
    errors = []
    for step in (dt, 0.499 * dt):
        t = make_solver(engine).solve(problem, StepControl(dt=step))
        assert t.status is Status.SUCCESS, t.message
        assert t.t[-1] == problem.t_end and t.counters["steps"] == len(t.t) - 1
        errors.append(np.max(np.abs(t.states.r - problem.reference().states(t.t).r)))
    assert errors[0] < 1e-3 and errors[1] < 0.35 * errors[0]


SPATIAL = {"omega_x": 5.0, "omega_z": 3.0}  # on a ball joint, where theta' is not v
ORDERS = [  # engine, options, problem, coarsest step, halvings, order, within
    *(
        ("mujoco", {"integrator": i}, ("spherical_pendulum", {**SPATIAL, "t_end": 1.0}), 0.02, 3, order, 0.2)
        for i, order in mujoco.INTEGRATORS.items()
    ),
    ("mujoco", {}, ("chain", {"t_end": 0.4}), 2e-3, 2, 2.0, 0.4),  # loops are soft by (1 - d) a_0 T^2, T = 2 dt
    *(
        ("pinocchio", {"integrator": i}, ("spherical_pendulum", {**SPATIAL, "t_end": 0.5}), 0.01, 2, order, 0.2)
        for i, order in pinocchio.INTEGRATORS.items()
    ),
    *(
        ("exudyn", {"integrator": "GeneralizedAlpha", **more}, ("heavy_top", {"t_end": 0.2}), 1e-3, 2, 2.0, 0.25)
        for more in ({}, {"spectral_radius": 0.5})
    ),
]


@pytest.mark.parametrize(
    ("name", "options", "problem", "dt", "halvings", "order", "within"),
    [pytest.param(*row, marks=needs(row[0])) for row in ORDERS],
)
def test_the_order_is_the_declared_one(name, options, problem, dt, halvings, order, within):
    p = make_problem(*problem)
    errors = [error(p, solve_run(p, dt / 2**k, name, **options)) for k in range(halvings + 1)]
    assert orders(errors)[-1] == pytest.approx(order, abs=within)


@pytest.mark.parametrize("name", ["sprung", "loaded", "loaded_in_time", "sliding", "guided", "tilting", "rolling"])
def test_joints_springs_and_loads_are_the_engines_own(engine, name):
    """By another method: the check at the start does not see what a row says once the bodies have turned."""
    if (engine in SPRINGLESS and name == "sprung") or name in UNLIKE[engine]:
        pytest.skip(f"{engine} has none")
    problem = dataclasses.replace(PROBLEMS[name](), t_end=0.3)
    problem = without_springs(problem) if engine in SPRINGLESS else problem
    exact = make_solver("rkmk_dop853").solve(problem, StepControl(rtol=1e-11)).states.r[-1]
    errors = [
        np.max(np.abs(make_solver(engine).solve(problem, StepControl(dt=dt)).states.r[-1] - exact))
        for dt in (2e-3, 1e-3)
    ]
    assert errors[0] < 1e-4 and errors[1] < 0.35 * errors[0]


@needs("mujoco", "pinocchio")
def test_two_engines_agree_where_their_scheme_is_the_same():
    """Semi-implicit Euler in the same joint coordinates: nothing but rounding is left between two codes."""
    problem = make_problem("heavy_top", {"t_end": 0.2})
    one, two = (make_solver(n, {"integrator": "Euler"}).solve(problem, CONTROL) for n in ("mujoco", "pinocchio"))
    np.testing.assert_allclose(one.states.R, two.states.R, atol=1e-11)  # rounding grows in 200 steps of a fast top
    np.testing.assert_allclose(one.states.Omega, two.states.Omega, atol=1e-9)


def test_stretches_join(engine, monkeypatch):
    """The clock is read between stretches; whatever their length, the motion is the same to the method's error."""
    problem = make_problem("heavy_top", {"t_end": 0.1})
    whole = make_solver(engine).solve(problem, CONTROL)
    march = module_of(engine).march
    monkeypatch.setattr(module_of(engine), "march", lambda *a, **k: march(*a, **{**k, "stretch": 7}))
    parts = make_solver(engine).solve(problem, CONTROL)
    np.testing.assert_array_equal(parts.t, whole.t)
    np.testing.assert_allclose(parts.states.r, whole.states.r, atol=1e-5)  # restarts of an implicit method


@needs("mujoco")
@pytest.mark.parametrize("settings", ["default", "file"])
def test_options_that_settings_of_others_replace_are_refused(settings):
    """Four integrators under four labels would be one."""
    problem = make_problem("heavy_top", {"t_end": 0.1})
    for given in ({"integrator": "implicit"}, {"tolerance": 1e-6, "impedance": 0.9}):
        words = make_solver("mujoco", {"settings": settings, **given}).refuses(problem, CONTROL)
        assert words is not None and words.endswith(f": leave {', '.join(given)} out")
    if settings == "default":
        assert make_solver("mujoco", {"settings": "default"}).refuses(problem, CONTROL) is None


@needs("mujoco")
@pytest.mark.parametrize("stretch", [20_000, 7])
def test_a_warning_of_mujoco_ends_the_run_with_its_reason(stretch, monkeypatch):
    """``rollout`` repeats its last state after a warning; ``mj_step`` says what came before the step that warned."""
    module, march, p = module_of("mujoco"), module_of("mujoco").march, make_problem("heavy_top", {"t_end": 2.0})
    solver, control = make_solver("mujoco", {"integrator": "Euler"}), StepControl(dt=0.02)
    monkeypatch.setattr(module, "march", lambda *a, **k: march(*a, **{**k, "stretch": stretch}))
    t = solver.solve(p, control)
    assert t.status is Status.DIVERGED and "MuJoCo warned and stopped: Nan, Inf or huge value in QACC" in t.message
    model, rows = module.Model(solver, p, control), []
    while not any(w.number for w in model.data.warning):
        rows.append(np.concatenate(([model.data.time], model.data.qpos, model.data.qvel)))
        model.mj.mj_step(model.model, model.data)
    exact = model.states(np.array(rows))
    assert 10 < len(t.t) == len(rows) < 100 and t.t[-1] == pytest.approx(rows[-1][0])
    np.testing.assert_array_equal(t.states.r, exact.r)


@needs("exudyn")
def test_rows_left_out_still_hold():
    """Of the grid's 70 rows 58 are stated; the others follow from them. Kept, they give the same motion."""
    problem, ends = PROBLEMS["grid"](), []
    for rows, words in (("drop", "58 of 70 constraint rows"), ("keep", "70 of 70 constraint rows")):
        options = {"redundant_rows": rows, "integrator": "GeneralizedAlpha"}
        t = make_solver("exudyn", options).solve(problem, StepControl(dt=5e-3))
        assert t.status is Status.SUCCESS, t.message
        assert t.notes[0] == words
        assert np.max(np.abs(constraint(problem.system, t.states))) < 1e-3
        ends.append(t.states.r[-1])
    np.testing.assert_allclose(*ends, atol=1e-4)


@needs("exudyn")
def test_redundant_rows_are_kept_by_the_integrator_of_index_3_alone():
    """Off the constraints redundant rows are independent: held as velocities they take a five-bar's energy."""
    case = read_case(ROOT / "results" / "published" / "fuzz" / "exudyn-21.json")
    problem, off = case.oracle.problem, []
    for dt in (problem.dt, problem.dt / 2):
        solver = make_solver("exudyn", {"redundant_rows": "keep", "integrator": "GeneralizedAlpha"})
        t = solver.solve(problem, StepControl(dt=dt))
        assert t.status is Status.SUCCESS and t.notes[0] == "25 of 25 constraint rows"
        off.append(case.oracle.measure_distance(t.states[-1], case.oracle.true_motion[0]))
    assert off[0] < 2e-3 and off[1] < 0.35 * off[0]
    solver, step = make_solver("exudyn", {"redundant_rows": "keep"}), StepControl(dt=problem.dt)
    assert solver.refuses(problem, step) == module_of("exudyn").KEPT
    model = module_of("exudyn").Model(solver, problem, step)
    states = model.states(model.advance(20, problem.dt))
    assert energy(problem.system, states)[0] < 0.1 * energy(problem.system, States.one(problem.initial))[0]
    assert np.max(np.abs(constraint_rate(problem.system, states))) < 1e-3


@needs("exudyn")
@pytest.mark.parametrize(("number", "integrator"), [(7, "TrapezoidalIndex2"), (237, "GeneralizedAlpha")])
def test_rows_that_wear_out_are_chosen_anew(number, integrator):
    """With the rows of the start a joint opens by 1 m, or the iteration fails; all together keep their rank."""
    drawn = draw_mechanism(1, number)
    problem, solver, errors = drawn.problem(), make_solver("exudyn", {"integrator": integrator}), []
    exact = make_solver("rkmk_dop853").solve(problem, StepControl(rtol=1e-11)).states.r[-1]
    for dt in (drawn.dt, 0.5 * drawn.dt):
        t = solver.solve(problem, StepControl(dt=dt))
        assert t.status is Status.SUCCESS and t.notes[2].startswith("rows chosen anew at t = "), (t.message, t.notes)
        assert np.max(np.abs(constraint(problem.system, t.states))) < 1e-3
        errors.append(np.max(np.abs(t.states.r[-1] - exact)))
    assert errors[0] < 1e-2 and errors[1] < 0.35 * errors[0]


@needs("exudyn")
def test_a_joint_that_opens_ends_the_run_in_words(monkeypatch):
    """Where no other rows are found; until then all joints hold."""
    choose, chosen, problem = exudyn_rows._choose_independent, [], draw_mechanism(1, 7).problem()

    def choose_once(*of):
        chosen.append(choose(*of))
        return chosen[0]

    monkeypatch.setattr(exudyn_rows, "_choose_independent", choose_once)
    t = make_solver("exudyn").solve(problem, StepControl(dt=0.01))
    assert t.status is Status.DIVERGED and 0.1 < t.t[-1] < 0.9
    assert t.message.endswith(module_of("exudyn").WITHIN)
    assert np.max(np.abs(constraint(problem.system, t.states))) < 1e-2


@needs("exudyn")
def test_a_singular_chart_is_refused_in_words():
    """Kept rows need Tait-Bryan angles; bars along X put them at their singularity."""
    problem = make_problem("four_bar_grid", {"rows": 1, "columns": 1})
    options = {"redundant_rows": "keep", "integrator": "GeneralizedAlpha"}
    said = make_solver("exudyn", options).refuses(problem, StepControl(dt=1e-2))
    assert said is not None and said.startswith("Tait-Bryan angles are singular at the start of body 'v1,0'")


@needs("pinocchio")
def test_gain_closes_the_gaps():
    """Cut joints hold through accelerations: errors open them as time goes on, unless the corrector is on."""
    problem, gaps = dataclasses.replace(PROBLEMS["slider_crank"](), t_end=4.0), {}
    for gain in (0.0, 10.0):
        t = make_solver("pinocchio", {"gain": gain}).solve(problem, StepControl(dt=1e-2))
        assert t.status is Status.SUCCESS, t.message
        gaps[gain] = np.max(np.abs(constraint(problem.system, t.states)))
    assert gaps[10.0] < 0.1 * gaps[0.0]


def test_a_loop_with_springs_is_that_of_the_strong_form_in_cvode():
    """A loop with springs against Runge-Kutta on another formulation; reactions at the start too."""
    problem = PROBLEMS["closed_chain"]()
    ours, theirs = (make_solver(n).solve(problem, StepControl(rtol=1e-10)) for n in ("rkmk_dop853", "cvode"))
    np.testing.assert_allclose(theirs.states.r[-1], ours.states.r[-1], atol=1e-7)
    np.testing.assert_allclose(theirs.reaction[0], ours.reaction[0], rtol=1e-8, atol=1e-8)


SPARSE = (5148, 5306, 5399, 5543, 6231)  # starts of random trees that MuJoCo 4.0.0 accelerates wrongly, by 78 to 780 %


def random_tree(rng, bodies, loops):
    """MJCF of a tree of hinges and balls whose bodies are tied together at ``loops`` points."""
    parents = [-1] + [int(rng.integers(-1 if rng.random() < 0.1 else max(0, i - 4), i)) for i in range(1, bodies)]
    places, axes = 0.5 * rng.normal(size=(bodies, 3)), rng.normal(size=(bodies, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    joints = ["ball" if rng.random() < 0.3 else "hinge" for _ in range(bodies)]
    parts = [ET.Element("mujoco")]
    option = ET.SubElement(parts[0], "option", solver="Newton", iterations="100", tolerance="1e-8")
    ET.SubElement(option, "flag", contact="disable")
    links = {-1: ET.SubElement(parts[0], "worldbody")}
    for i in range(bodies):
        links[i] = ET.SubElement(links[parents[i]], "body", name=f"b{i}", pos=" ".join(map(str, places[i])))
        hinge = {"axis": " ".join(map(str, axes[i]))} if joints[i] == "hinge" else {}
        ET.SubElement(links[i], "joint", type=joints[i], **hinge)
        ET.SubElement(links[i], "inertial", pos=".1 .05 .02", mass="1", diaginertia=".1 .12 .15")
    ties = ET.SubElement(parts[0], "equality")
    for _ in range(loops):
        one, two = rng.choice(bodies, 2, replace=False)
        ET.SubElement(ties, "connect", body1=f"b{one}", body2=f"b{two}", anchor=".2 .1 .1")
    return ET.tostring(parts[0], encoding="unicode")


@needs("mujoco")
@pytest.mark.parametrize("seed", SPARSE)
def test_accelerations_of_mujoco_do_not_depend_on_how_rows_are_stored(seed):
    """Dense or sparse: google-deepmind/mujoco#3767."""
    mj, drawn = import_package("mujoco"), np.random.default_rng(seed)
    bodies, loops = int(drawn.integers(20, 65)), int(drawn.integers(3, 12))
    model = mj.MjModel.from_xml_string(random_tree(np.random.default_rng(seed), bodies, loops))
    found = []
    for model.opt.jacobian in (mj.mjtJacobian.mjJAC_DENSE, mj.mjtJacobian.mjJAC_SPARSE):
        data = mj.MjData(model)
        data.qvel[:] = np.random.default_rng(seed).normal(size=model.nv)
        mj.mj_forward(model, data)
        found.append(data.qacc.copy())
    assert np.max(np.abs(found[1] - found[0])) < 1e-9 * np.max(np.abs(found[0]))
