"""Engines that hand out no mass matrix, in single precision or stepped: their model check, their orders, loops."""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.motion import constraint
from mbsbench.harness.mechanics.types import Status, StepControl
from mbsbench.solvers.engines.export import process, protocol
from mbsbench.solvers.engines.export.model_check import measure_differences
from mbsbench.solvers.engines.newton import Newton

from .systems import PROBLEMS
from .test_engines import without_springs

WHEELS = {"newton": "newton", "mujoco_warp": "mujoco-warp", "pybullet": "pybullet"}
SETTINGS = {  # name and options, and the inertia's share that its check must notice
    "featherstone": ("newton", {"solver": "Featherstone"}, 0.05),
    "newton_mujoco": ("newton", {"solver": "MuJoCo"}, 1e-4),
    "kamino": ("newton", {"solver": "Kamino"}, 0.05),
    "xpbd": ("newton", {"solver": "XPBD"}, 1e-4),
    "mujoco_warp": ("mujoco_warp", {}, 1e-4),
    "pybullet": ("pybullet", {}, 1e-8),
}
PENDULUM = "spherical_pendulum", {"omega_x": 5.0, "omega_z": 3.0, "t_end": 0.2}
CONTROL = StepControl(dt=1e-3)


def needs(name):
    absent = process.find_environment(name) is None and importlib.util.find_spec(name) is None
    return pytest.mark.skipif(absent, reason=f"{WHEELS[name]} is an optional extra: make test-engines")


SLOW = {"kamino": [pytest.mark.slow]}


@pytest.fixture(params=[pytest.param(key, marks=[needs(v[0]), *SLOW.get(key, [])]) for key, v in SETTINGS.items()])
def settings(request):
    """An installed engine with options."""
    return SETTINGS[request.param]


@pytest.mark.parametrize("name", WHEELS)
def test_without_the_package_it_refuses_with_the_remedy(name, monkeypatch):
    """A refusal is a result, in one line."""
    monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr(protocol, "find_environment", lambda inside: None)
    said = make_solver(name).refuses(make_problem("heavy_top"), CONTROL)
    assert said == f"{WHEELS[name]} is not installed: pip install 'mbsbench[engines]'"


def test_its_model_is_ours_and_a_planted_inertia_is_not(settings, monkeypatch):
    """Tilted inertias on a tree; what is planted is in what the engine is given, not in the problem."""
    name, options, share = settings
    problem = make_problem(*PENDULUM)
    assert make_solver(name, options).refuses(problem, CONTROL) is None
    right = protocol.flatten_tree

    def planted(tree, system, start):
        return right(tree, replace(system, inertia=(1.0 + share) * system.inertia), start)

    monkeypatch.setattr(protocol, "flatten_tree", planted)
    said = make_solver(name, options).refuses(problem, CONTROL)
    assert said is not None and "is not that of spherical_pendulum" in said


def test_loops_of_tilted_bodies_are_ours(settings):
    """A chain of spherical and revolute joints in a loop passes the check and stays closed, or is refused in words."""
    name, options, _ = settings
    problem = without_springs(PROBLEMS["closed_chain"]())
    said = make_solver(name, options).refuses(problem, CONTROL)
    if options.get("solver") == "Featherstone":
        assert said is not None and "the system has loops" in said
        return
    assert said is None
    t = make_solver(name, options).solve(replace(problem, t_end=0.02), CONTROL)
    assert t.status is Status.SUCCESS, t.message
    assert np.max(np.abs(constraint(problem.system, t.states))) < 0.02


BY_FORCES = [
    pytest.param(*SETTINGS[key][:2], marks=needs(SETTINGS[key][0]), id=key)
    for key in ("newton_mujoco", "xpbd", "mujoco_warp")
]


@pytest.mark.parametrize(("name", "options"), BY_FORCES)
@pytest.mark.parametrize("which", ["perturbed_chain", "grid", "sprung", "heavy_top", "free_body"])
def test_forces_in_single_precision_are_ours_to_counted_roundings(name, options, which):
    """Slender rods give the mass matrix a condition of 1e4: accelerations differ by 3e-3, their residual does not."""
    problem = without_springs(PROBLEMS[which]()) if which in PROBLEMS else make_problem(which)
    assert make_solver(name, options).refuses(problem, CONTROL) is None


MOTIONS = [  # name and options, problem, distance [m] that rounding or the order of its steps leaves at 1e-3 s
    *(("mujoco_warp", {}, which, 1e-5) for which in ("jointed", "jointed_otherwise", "sprung", "loaded", "sliding")),
    *(("newton", {"solver": "MuJoCo"}, which, 1e-4) for which in ("jointed", "jointed_otherwise")),
    *(("newton", {"solver": "Featherstone"}, which, 5e-3) for which in ("jointed", "jointed_otherwise")),
    ("pybullet", {}, "jointed", 5e-3),
]


@pytest.mark.parametrize(
    ("name", "options", "which", "close"),
    [pytest.param(*row, marks=needs(row[0]), id=f"{row[0]} {row[1].get('solver', '')} {row[2]}") for row in MOTIONS],
)
def test_slides_welds_springs_and_loads_move_as_by_another_method(name, options, which, close):
    """A row that is right at the start may say something else once the bodies have turned."""
    problem = replace(PROBLEMS[which](), t_end=0.1)
    exact = make_solver("rkmk_dop853").solve(problem, StepControl(rtol=1e-11)).states[-1]
    t = make_solver(name, options).solve(problem, CONTROL)
    assert t.status is Status.SUCCESS, t.message
    assert np.max(np.abs(t.states[-1].r - exact.r)) < close and np.max(np.abs(exact.r - problem.initial.r)) > 20 * close


@pytest.mark.parametrize(("name", "options"), BY_FORCES)
@pytest.mark.parametrize("what", ["gravity", "mass", "point of a cut joint", "point of a joint"])
def test_a_fault_of_a_thousandth_is_seen(name, options, what, monkeypatch):
    right = protocol.flatten_tree

    def planted(tree, system, start):
        data = right(tree, system, start)
        if what == "gravity":
            data["gravity"] = 1.001 * data["gravity"]
        elif what == "mass":
            data["limbs"][-1]["mass"] *= 1.001
        elif what == "point of a joint":
            data["limbs"][-1]["s_child"] = data["limbs"][-1]["s_child"] + 1e-3
        else:
            data["cuts"][0]["s_i"] = data["cuts"][0]["s_i"] + 1e-3
        return data

    monkeypatch.setattr(protocol, "flatten_tree", planted)
    said = make_solver(name, options).refuses(PROBLEMS["grid"](), CONTROL)
    assert said is not None and "is not that of four_bar_grid" in said


@needs("pybullet")
@pytest.mark.parametrize("name", ["perturbed_chain", "sprung", "closed_chain"])
def test_the_mass_matrix_of_bullets_steps_is_ours(name):
    """Unit forces on every velocity of its own: balls in a row, a floating base, tilted principal axes."""
    problem = without_springs(PROBLEMS[name]())
    found = measure_differences(problem, protocol.Model(make_solver("pybullet"), problem, CONTROL).describe_start())
    assert found["mass matrix"] < 1e-10 and max(found.values()) < 1e-10


def test_errors_halve_with_the_step(settings):
    """First order, or so small that single precision shows."""
    name, options, _ = settings
    p, errors = make_problem(*PENDULUM), []
    for dt in (4e-3, 2e-3):
        t = make_solver(name, options).solve(p, StepControl(dt=dt))
        assert t.status is Status.SUCCESS, t.message
        errors.append(np.max(np.abs(t.states.r - p.reference().states(t.t).r)))
    assert errors[1] < 0.6 * errors[0] or errors[1] < 1e-4


@needs("newton")
def test_unequal_relaxations_move_another_body():
    """XPBD's 0.7 for forces and 0.4 for torques of one joint: no step is short enough; equal ones converge."""
    p, errors = make_problem("spherical_pendulum", {"omega_z": 0.1, "t_end": 0.2}), {}
    for options in ({"settings": "default"}, {}):
        for dt in (4e-3, 2e-3):
            t = Newton(solver="XPBD", **options).solve(p, StepControl(dt=dt))
            errors[bool(options), dt] = np.max(np.abs(t.states.r - p.reference().states(t.t).r))
    assert errors[False, 2e-3] < 0.6 * errors[False, 4e-3]
    assert errors[True, 2e-3] > 0.9 * errors[True, 4e-3]


@needs("pybullet")
def test_a_model_of_bullet_that_is_replaced_is_freed():
    """A server takes 118 MB."""
    problem, solver, used = make_problem(*PENDULUM), make_solver("pybullet"), []
    for models in (2, 10):
        for _ in range(models):
            assert solver.refuses(problem, CONTROL) is None
        one = process.get_process("pybullet", process.find_environment("pybullet"))
        lines = Path(f"/proc/{one.process.pid}/status").read_text().splitlines()
        used.append(int(next(line for line in lines if line.startswith("VmData")).split()[1]))
    assert used[1] - used[0] < 100_000  # kB
