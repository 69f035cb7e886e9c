"""The status of a run is that of its method: no frame and no rounding of its start changes it.

An iteration that ends near its limit, or a test that rounding decides, fails in one frame and succeeds in another.
"""

import dataclasses
from typing import Any

import numpy as np
import pytest
import scipy.linalg

from mbsbench import Problem, Status, StepControl, Trajectory
from mbsbench.harness.catalogue.registry import make_problem, make_solver, solvers
from mbsbench.harness.catalogue.suites.suite import load_suite
from mbsbench.harness.mechanics import so3
from mbsbench.harness.mechanics.fixed_order import principal_axes
from mbsbench.solvers.formulations import linear
from mbsbench.solvers.formulations.compiled.kernel import make_kernel, set_state
from mbsbench.solvers.formulations.joint_coordinates import symplectic
from mbsbench.solvers.formulations.joint_coordinates.collocation import (
    compute_extrapolation_weights,
    make_gauss_lobatto_tableau,
)
from mbsbench.solvers.formulations.rows.mechanism import SymbolicMechanism
from mbsbench.tests.comparing import assert_same

SPECS = load_suite("ci").specs
MOVING = "spherical_pendulum[omega_z=3,t_end=5]"  # spatial and loaded: every term of the equations counts
TILTS = [(0.3, 0.2, 0.1), (-1.1, 0.4, 0.9), (1e-3, 7e-4, 0.0), (1e-5, 0.0, 2e-5), (1e-15, 2e-15, -1e-15)]  # [rad]
REDUNDANT = {  # how far a frame moves a run of the gate [m]
    "al_index3": 1e-10,  # of its multipliers' regularisation
    "gc_composed": 1e-9,  # phi is not corrected, and falls with the order alone
    "gc_augmented_lagrangian": 1e-5,  # ODE-GC's error depends on the frame, through c_R
    "generalized_alpha": 1e-11, "energy_momentum": 1e-11, "lie_variational": 1e-11, "half_explicit": 1e-11,
    "rattle": 1e-11,
    "radau_ggl": 1e-5, "rkmk_dop853": 1e-5,  # rtol 1e-6: axes choose steps, by errors of components
}  # fmt: skip
YAWS = 0.01 * np.arange(20)  # [rad]
FEW, ALL = ((0, 7, 13), 1), (range(20), 5)  # which of these yaws, and how many starts changed by rounding
MOST_SWEEPS = 30  # half of the limit, in any step
GATE = ["spherical_pendulum[omega_z=3,t_end=5]", "spherical_pendulum[omega_z=0.1,t_end=5]", "heavy_top", "torque_free"]


def find_specs(solver: str, begins: str = MOVING) -> list[Any]:
    return [c for c in SPECS if c.solver == solver and c.case.startswith(begins) and not c.options]


def solve_turned(spec: Any, yaw: float, t_end: float, seed: int | None = None) -> Trajectory:
    """The run from a start turned by ``yaw`` and, with a seed, changed by rounding."""
    problem = make_problem(spec.problem, {**spec.parameters, "yaw": float(yaw), "t_end": t_end})
    if seed is not None:
        problem = change_by_rounding(problem, seed)
    return make_solver(spec.solver, spec.options).solve(problem, spec.control)


def change_by_rounding(problem: Problem, seed: int) -> Problem:
    """Change each number of the start by 1e-15 of itself."""
    random, start = np.random.default_rng(seed), problem.initial
    changed = {
        name: getattr(start, name) * (1.0 + 1e-15 * random.standard_normal(getattr(start, name).shape))
        for name in ("r", "R", "v", "Omega")
    }
    return dataclasses.replace(problem, initial=dataclasses.replace(start, **changed))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("how_many", [FEW, pytest.param(ALL, marks=pytest.mark.slow)], ids=["few", "all"])
@pytest.mark.parametrize("solver", sorted({c.solver for c in SPECS} & set(solvers())))
def test_no_frame_and_no_rounding_changes_a_status(solver: str, how_many: Any) -> None:
    """Every method of the gate, at the gate's setting, over the fall and the first rise of the pendulum."""
    (spec,) = find_specs(solver)
    t_end = spec.parameters["t_end"] if solver == "gauss_joint" else 1.0  # of long steps, which take most sweeps
    turned, changed = how_many
    out = [solve_turned(spec, YAWS[k], t_end) for k in turned] + [
        solve_turned(spec, 0.0, t_end, seed) for seed in range(changed)
    ]
    assert {o.status for o in out} == {Status.SUCCESS}, [o.message for o in out]


SHORTER = {"radau_ggl": 0.3, "rkmk_dop853": 0.3}  # [s] of the few frames: error control takes small steps here


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("tilts", "seeds"), [(TILTS[1:4:2], 1), pytest.param(TILTS, 2, marks=pytest.mark.slow)], ids=["few", "all"]
)
@pytest.mark.parametrize("solver", REDUNDANT)
def test_no_frame_takes_a_plane_grid_out_of_its_plane(solver: str, tilts: list[Any], seeds: int) -> None:
    """75 of the grid's 400 rows are redundant, and its bars are slender: rounding across the plane grows in them."""
    (spec,) = find_specs(solver, "four_bar_grid[t_end=1]")[:1]
    t_end = 1.0 if tilts is TILTS else SHORTER.get(solver, 1.0)
    changes = ({}, *({"rotation": tilt} for tilt in tilts), *({"perturb": 1e-15, "seed": k} for k in range(seeds)))
    first, *others = [
        make_solver(solver).solve(make_problem("four_bar_grid", {"t_end": t_end, **changed}), spec.control)
        for changed in changes
    ]
    distances = [np.linalg.norm(o.states.r[-1] - o.states.r[-1, 0], axis=1) for o in (first, *others)]
    assert {o.status for o in (first, *others)} == {Status.SUCCESS}, [o.message for o in others]
    assert max(np.max(np.abs(d - distances[0])) for d in distances) < REDUNDANT[solver]


@pytest.mark.parametrize("tilt", [(0.0, 0.0, 0.0), *TILTS[:3]])
def test_redundant_rows_of_hinges_lie_along_their_axes(tilt: tuple[float, ...]) -> None:
    """In every frame S x = b is solved by an x without force along the axes where the rows across them suffice."""
    problem = make_problem("four_bar_grid", {"rotation": tilt})
    k = make_kernel(problem.system)
    set_state(k, problem.initial)
    k.accelerate.run()
    axis = so3.exp(np.array(tilt)) @ np.array([0.0, 1.0, 0.0])
    lam = k.lam.reshape(-1, 5)
    assert k.state["rank"] == 325 and len(lam) == 80
    assert np.max(np.abs(lam[:, :3] @ axis)) < 1e-9 * np.max(np.abs(lam))
    acceleration = k.v_dot[:, :3] @ axis
    assert np.max(np.abs(acceleration)) < 1e-11


@pytest.mark.parametrize(("solver", "inertias"), [("ida_index1", (1.0, 1.0, 1.0)), ("ida_index3", (1.0, 1.5, 2.0))])
def test_multipliers_that_nothing_needs_do_not_grow_from_rounding(solver: str, inertias: tuple[float, ...]) -> None:
    """A free body on its joint, 1e-15 m off: with IDA's own scaling of corrections they would reach 1e3 N by 4 s."""
    pytest.importorskip("sksundae")
    given = {"t_end": 10.0, "inertia_factors": inertias, "perturb": 1e-15, "seed": 1}
    out = make_solver(solver).solve(make_problem("torque_free_body", given), StepControl(rtol=1e-8))
    assert out.status is Status.SUCCESS
    assert np.max(np.abs(out.reaction)) < 1e-2  # 1e-15 m over the first step of 1e-5 s, squared, is 1e-4 N of index 3


@pytest.mark.parametrize("every", [pytest.param(1, marks=pytest.mark.slow), 10], ids=["all", "few"])
@pytest.mark.parametrize("begins", GATE)
@pytest.mark.parametrize("solver", ["gauss_joint", "rattle_joint"])
def test_sweeps_end_far_from_their_limit(solver: str, begins: str, every: int) -> None:
    """40 frames at the gate's setting, or a few; the longest steps are those of Gauss on the pendulum, h = 0.1 s."""
    (spec,) = find_specs(solver, begins)
    frames = (0.01 * np.arange(40) if solver == "gauss_joint" else YAWS[:5])[::every]
    out = [solve_turned(spec, yaw, spec.parameters["t_end"]) for yaw in frames]
    out += [solve_turned(spec, 0.0, spec.parameters["t_end"], seed) for seed in range(0, 5, every)]
    assert {o.status for o in out} == {Status.SUCCESS}, [o.message for o in out]
    assert max(o.counters["most_sweeps"] for o in out) <= MOST_SWEEPS < symplectic.MOST_SWEEPS


@pytest.mark.parametrize(
    ("solver", "name", "parameters", "dt"),
    [
        ("gauss_joint", "spherical_pendulum", {"omega_z": 3.0, "t_end": 2.0}, 0.05),
        ("gauss_joint", "four_bar_grid", {"t_end": 0.4}, 0.05),
        ("rattle_joint", "bricard", {"t_end": 0.5}, 0.05),
    ],
)
def test_acceleration_leaves_the_steps(
    solver: str, name: str, parameters: dict[str, float], dt: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Plain and accelerated sweeps solve the same equations, with and without rows: the same motion to rounding."""
    out = []
    for plain in (1000, 0):  # never, and at the first look
        monkeypatch.setattr(symplectic, "PLAIN_SWEEPS", plain)
        out.append(make_solver(solver).solve(make_problem(name, parameters), StepControl(dt=dt)))
    sweeps, accelerated = (o.counters["newton_iterations"] for o in out)
    assert accelerated < sweeps
    for of in ("r", "R", "v", "Omega"):
        a, b = (getattr(o.states, of) for o in out)
        assert np.max(np.abs(a - b)) < 1e-11 * max(1.0, float(np.max(np.abs(a))))  # some 100 steps of 1e-13


@pytest.mark.parametrize(
    ("solver", "control", "size"),
    [
        ("radau_ggl", StepControl(rtol=1e-6), 1e7),
        ("gc_composed", StepControl(dt=0.01), 1e5),
        ("gc_extrapolated", StepControl(rtol=1e-8), 1e5),
        ("gc_weak_form", StepControl(dt=0.01), 1e5),
        ("rattle", StepControl(dt=0.01), 1e7),
        ("al_index3", StepControl(dt=0.01), 1e7),
        ("generalized_alpha", StepControl(dt=0.01), 1e7),
        ("energy_momentum", StepControl(dt=0.01), 1e7),
        ("half_explicit", StepControl(dt=0.01), 1e7),
        ("gauss_joint", StepControl(dt=0.05), 1e5),
        ("rattle_joint", StepControl(dt=0.01), 1e5),
    ],
)
def test_no_tolerance_of_an_iteration_is_below_rounding(solver: str, control: StepControl, size: float) -> None:
    """The pendulum drawn larger, gravity with it, moves alike: a fixed tolerance [m, sqrt(J)] would be out of reach."""
    scaled = {"half_length": 0.5 * size, "radius": 0.1 * size, "gravity": 9.81 * size}
    out = make_solver(solver).solve(
        make_problem("spherical_pendulum", {**scaled, "omega_z": 3.0, "t_end": 1.0}), control
    )
    assert out.status is Status.SUCCESS, out.message


OF_NUMPY = ("inv", "pinv", "solve", "lstsq", "qr", "svd", "eigh", "eigvalsh", "eig", "eigvals", "cholesky", "det")
OF_SCIPY = ("inv", "solve", "lstsq", "qr", "svd", "eigh", "lu_factor", "cho_factor", "cholesky", "null_space")


@pytest.mark.parametrize(
    ("solver", "name", "control"),
    [
        ("gauss_joint", "four_bar_grid", StepControl(dt=0.002)),
        ("rattle_joint", "chain", StepControl(dt=0.002)),
        ("dop853_joint", "chain", StepControl(rtol=1e-6)),
        ("gc_weak_form", "chain", StepControl(dt=0.002)),
        ("rattle", "chain", StepControl(dt=0.002)),
        ("gc_composed", "chain", StepControl(dt=0.002)),
        ("radau_ggl", "chain", StepControl(rtol=1e-6)),
        ("generalized_alpha", "chain", StepControl(dt=0.002)),
        ("rattle", "random_mechanism", StepControl(dt=0.002)),  # inertias with products
    ],
)
def test_no_linear_algebra_of_a_library_is_in_a_run(
    solver: str, name: str, control: StepControl, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its bits differ between processors: tableaux, estimates, axes and components come from fractions and products.

    ``rows_to_keep`` chooses rows by pivots of LAPACK's: no number of these enters a motion, so it may.
    """
    problem = make_problem(name, {"t_end": 0.01})
    make_solver(solver).solve(problem, control)

    def refuse(*given: Any, **options: Any) -> None:
        raise AssertionError("linear algebra of a library")

    for library, functions in ((np.linalg, OF_NUMPY), (scipy.linalg, OF_SCIPY)):
        for function in functions:
            monkeypatch.setattr(library, function, refuse)
    monkeypatch.setattr(linear, "call_lapack", refuse)
    make_gauss_lobatto_tableau.cache_clear()
    compute_extrapolation_weights.cache_clear()
    SymbolicMechanism(problem.system, (), (), chooses=False)  # whose numbers are in code that is kept from other runs
    out = make_solver(solver).solve(problem, control)
    assert out.status is Status.SUCCESS, out.message


def test_principal_axes_are_those_of_the_library() -> None:
    """Both agree for bodies with inertias up to nine decades apart, two of them equal in every third."""
    random = np.random.default_rng(0)
    for k in range(300):
        Q, J = np.linalg.qr(random.normal(size=(3, 3)))[0], np.sort(10.0 ** random.uniform(-6.0, 3.0, 3))
        J[1] = J[2] if k % 3 == 0 else J[1]
        A = Q @ np.diag(J) @ Q.T
        A = 0.5 * (A + A.T)
        found, axes = principal_axes(A)
        assert np.max(np.abs(np.array(found) - np.linalg.eigvalsh(A))) < 1e-14 * J[2]
        assert np.max(np.abs(A @ axes - axes * np.array(found))) < 1e-14 * J[2]


def test_principal_axes_of_a_stack_are_those_of_each_body() -> None:
    """Bodies that need other turns do not change each other; a diagonal inertia has the axes of its frame."""
    random = np.random.default_rng(1)
    B = random.normal(size=(20, 3, 3))
    stack = B @ np.swapaxes(B, 1, 2)
    stack[::3] = np.eye(3) * np.sort(random.uniform(size=(7, 1, 3)))
    moments, axes = principal_axes(stack)
    for k, A in enumerate(stack):
        alone = principal_axes(A)
        assert_same(moments[k], alone[0])
        assert_same(axes[k], alone[1])
    assert_same(axes[::3], np.broadcast_to(np.eye(3), (7, 3, 3)))
    assert_same(moments[::3], np.diagonal(stack[::3], axis1=1, axis2=2))
