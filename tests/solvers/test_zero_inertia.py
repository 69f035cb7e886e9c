"""Motions of slender rods and point masses: exact ones, those of lent inertia that changes nothing, and limits."""

import dataclasses

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.execution.presented import presented
from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.harness.mechanics.motion import energy
from mbsbench.harness.reference.computed import computed
from mbsbench.harness.types import Problem, Status, StepControl, Trajectory

TAKE = ("rkmk_dopri5", "rkmk_dop853", "ida_index1", "ida_index2", "ndf_index1", "radau_index1", "scipy_strong_form")
ARM = {"gyration": 0.0, "t_end": 1.0}  # a point mass on a massless arm
OTHERWISE = {"yaw": 0.4, "perturb": 0.2, "renumber": 2, "mirror": "X", "unit_length": 100.0}
RODS = {"section": "thin", "axial_inertia": 0.0, "t_end": 1.0}


def solved(p: Problem, name: str, size: float, **options: object) -> Trajectory:
    """``size``: rtol or dt."""
    made = make_solver(name, options)
    solver, control = presented(made, p), StepControl(**{made.control: size})
    assert solver.refuses(p, control) is None
    out = solver.solve(p, control)
    assert out.status is Status.SUCCESS, out.message
    return out


def off(p: Problem, out: Trajectory) -> float:
    """Largest distance of an end from the reference [m]."""
    reference = p.reference()
    assert reference is not None
    return float(np.max(np.abs(out.states.r - reference.states(out.t).r)))


@pytest.mark.parametrize("given", [{}, OTHERWISE])
@pytest.mark.parametrize(
    ("solver", "size", "allowed"),
    [("rkmk_dop853", 1e-10, 1e-10), ("rattle", 1e-3, 1e-5), ("gc_weak_form", 1e-3, 1e-5), ("ida_index1", 1e-9, 1e-6),
     ("rk45_strong_form", 1e-9, 1e-7)],
)  # fmt: skip
def test_a_point_mass_on_a_link_is_a_pendulum(solver: str, size: float, allowed: float, given: dict) -> None:
    """By theta functions, on both routes; errors are those of the steps."""
    p = make_problem("simple_pendulum", {"support": "link", "t_end": 1.0, **given})
    assert off(p, solved(p, solver, size)) < allowed


@pytest.mark.parametrize("solver", TAKE)
@pytest.mark.parametrize("given", [{}, OTHERWISE])
def test_a_point_mass_on_a_massless_arm_is_a_pendulum(solver: str, given: dict) -> None:
    """Its inertia about the hinge is m L^2, which its joint alone gives it."""
    p = make_problem("simple_pendulum", {**ARM, **given})
    out = solved(p, solver, 1e-9)
    assert off(p, out) < 1e-6
    assert np.ptp(energy(p.system, out.states)) < 1e-5  # of 9.81 J


@pytest.mark.parametrize("solver", ["rkmk_dop853", "scipy_strong_form"])
def test_lent_inertia_that_is_kept_is_another_pendulum(solver: str) -> None:
    """What the test above would see: with a hundredth of m L^2 it swings half a percent more slowly."""
    p = make_problem("simple_pendulum", ARM)
    wrong = dataclasses.replace(p)
    object.__setattr__(wrong, "system", dataclasses.replace(p.system, coupled=np.zeros((1, 3, 3))))
    assert off(p, solved(wrong, solver, 1e-8)) > 1e-3


@pytest.mark.parametrize(
    ("solver", "size"),
    [("rattle", 1e-3), ("gc_augmented_lagrangian", 1e-3), ("rkmk_dop853", 1e-8), ("ndf_index1", 1e-6)],
)
def test_axial_inertia_in_a_plane_changes_nothing(solver: str, size: float) -> None:
    """A grid of slender rods (redundant rows) as with 1e-4 kg m2 put in by hand: motion, energy, loads of joints."""
    given = {"rows": 1, "columns": 2, "t_end": 0.2}
    none, some = (make_problem("four_bar_grid", {**given, "axial_inertia": J}) for J in (0.0, 1e-4))
    assert np.all(none.system.coupled == 0.0)
    a, b = (solved(p, solver, size) for p in (none, some))
    assert len(a.t) == len(b.t)
    assert np.allclose(a.states.r, b.states.r, rtol=0.0, atol=1e-10)
    assert np.allclose(energy(none.system, a.states), energy(some.system, b.states), rtol=1e-11)
    loads = [constraint_jacobian(none.system, out.states[-1]).T @ out.reaction[-1] for out in (a, b)]
    assert np.allclose(*loads, rtol=0.0, atol=1e-8 * np.max(np.abs(loads)))


def test_slender_rods_are_the_limit_of_thin_ones() -> None:
    """Bricard's P3 moves by 0.25 m per kg m2 of axial inertia: first order, down to none."""
    ends = []
    for axial in (1e-5, 1e-6, 0.0):
        p = make_problem("bricard", {"section": "thin", "axial_inertia": axial, "t_end": 5.0})
        ends.append(p3(p, solved(p, "rkmk_dop853", 1e-11))[-1])
    far, near = (np.linalg.norm(end - ends[-1]) for end in ends[:2])
    assert np.log10(far / near) == pytest.approx(1.0, abs=1e-2)
    assert far > 1e-7


@pytest.mark.parametrize(
    ("solver", "options"),
    [("rkmk_dop853", {}), ("radau_index1", {}), ("ida_index2", {}), ("rk45_strong_form", {"coordinates": "euler313"})],
)
def test_slender_rods_make_the_published_curve(solver: str, options: dict) -> None:
    """A04 at 0.2, 1 and 2 s, to the digits printed."""
    printed = {0.2: (0.961273, -0.999279, -0.0379769), 1.0: (0.273334, -0.886544, -0.462644),
               2.0: (-0.779947, -0.980636, -0.195841)}  # fmt: skip
    for t, expected in printed.items():
        p = make_problem("bricard", {"section": "thin", "axial_inertia": 0.0, "t_end": t})
        assert np.max(np.abs(p3(p, solved(p, solver, 1e-9, **options))[-1] - expected)) < 1e-6


def p3(p: Problem, out: Trajectory) -> np.ndarray:
    seen = p.observe(out.states)
    return np.stack([seen[k] for k in ("P3_x", "P3_y", "P3_z")], axis=-1)


def test_two_routes_of_the_reference_agree_on_slender_rods() -> None:
    """Newton and Euler, and natural coordinates, both without inertia about the axes; and the solvers' motion."""
    p = make_problem("bricard", RODS)
    motion = computed(p)
    assert motion is not None and motion.horizon == p.t_end
    out = solved(p, "rkmk_dop853", 1e-11)
    assert np.max(motion.error(out.t)) < 1e-9
    assert np.max(np.abs(motion.states(out.t).r - out.states.r)) < 1e-9


@pytest.mark.parametrize("solver", ["gc_weak_form", "rattle", "half_explicit", "radau_ggl", "al_index3", "cvode"])
def test_methods_that_invert_each_inertia_refuse_arms_without_mass(solver: str) -> None:
    """In a line that says what takes it; CVODE solves the strong form and does."""
    made = make_solver(solver)
    said = made.refuses(make_problem("simple_pendulum", ARM), StepControl(**{made.control: 1e-3}))
    assert said is None if solver == "cvode" else "use rkmk_dop853, ida_index1 or rk45_strong_form" in (said or "")


@pytest.mark.parametrize(
    ("solver", "option"), [("ida_index1", {"form": "se"}), ("ndf_index1", {"accelerations": "eliminated"})]
)
def test_forms_with_the_inverse_of_m_refuse_too(solver: str, option: dict) -> None:
    """w = M^-1 (f - h + A^T lam) is not there."""
    assert make_solver(solver, option).refuses(make_problem("simple_pendulum", ARM), StepControl(rtol=1e-6))
