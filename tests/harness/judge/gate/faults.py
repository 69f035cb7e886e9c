"""Forty faults that somebody could plant, or commit by mistake: each is one change of a line.

``runs`` begins the cases of the suite ``ci`` that meet the changed line: if the gate closes on these, it closes on all.
"""

from typing import NamedTuple


class Fault(NamedTuple):
    """``old``, which stands once in ``file``, becomes ``new``; ``open`` says why the gate does not close, if so."""

    file: str
    old: str
    new: str
    runs: tuple[str, ...]
    open: str = ""


def of(variant: str, *solvers: str) -> tuple[str, ...]:
    """The cases of these solvers."""
    return tuple(f"{variant} {solver}" for solver in solvers)


TOP, CHAIN = "heavy_top[t_end=1]", "chain[t_end=0.5]"
PENDULUM = "spherical_pendulum[omega_z=3,t_end=5]"
TURNED = "spherical_pendulum[omega_z=0.1,rotation=(0.3,-0.5,0.7),t_end=5]"
WRONG = ("spherical_pendulum ida_index1[coordinates=euler313,lambda_in_error_test=true] rtol=0.002",)
TURNING = ("torque_free_body[inertia_factors=(1,1.5,2)] gc_weak_form dt=0.1",)
INACCURATE = ("spherical_pendulum[omega_z=0.1] gc_weak_form[gauge=zero] dt=0.05",)
METHODS, SYMBOLIC = "solvers/formulations/methods/", "solvers/formulations/symbolic.py"
MOTION, ENDS, MEASURE = "harness/mechanics/motion.py", "harness/mechanics/ends.py", "harness/judge/metrics/measure.py"
ONE = of(PENDULUM, "rk45_strong_form")
TOPS = of(TOP, "rk45_strong_form")

FAULTS = (
    # problems: numbers that solvers and references share
    Fault("problems/heavy_top.py", '"m/s2")] = 9.81', '"m/s2")] = 9.80', TOPS),
    Fault("problems/heavy_top.py", "inertia_transverse - mass * length**2", "inertia_transverse", TOPS),
    Fault("problems/heavy_top.py", "phi_dot0 * np.sin(theta), spin]", "phi_dot0 * np.sin(theta), 0.999 * spin]", TOPS),
    Fault("problems/spherical_pendulum.py", "axial = 0.5 * mass * radius**2", "axial = 0.4 * mass * radius**2", ONE),
    Fault(
        "problems/chain.py",
        "transverse = mass * length**2 / 12.0",
        "transverse = mass * length**2 / 12.1",
        of(CHAIN, "rk45_strong_form"),
    ),
    Fault("problems/spherical_pendulum.py", '"m/s2")] = 9.81', '"m/s2")] = 9.811', ONE),
    # mechanics: what every motion is measured with
    Fault(MOTION, "return 0.5 * (translation + rotation)", "return 0.5 * translation", ONE),
    Fault(
        MOTION,
        "return kinetic_energy(system, s) + potential_energy(system, s)",
        "return kinetic_energy(system, s) - potential_energy(system, s)",
        ONE,
    ),
    Fault(
        MOTION,
        "return kinetic_energy(system, s) + potential_energy(system, s)",
        "return 0.0 * potential_energy(system, s)",
        ONE,
    ),
    Fault(ENDS, "x_i = r[:, i] + turn_vectors(s, i, system.joint_s_i[joints])", "x_i = r[:, i]", ONE),
    Fault(ENDS, "v[:, i] + find_vector_rates(s, i, system", "v[:, i] - find_vector_rates(s, i, system", ONE),
    Fault("harness/mechanics/so3.py", "return 2.0 * np.arcsin(", "return np.arcsin(", of(PENDULUM, "gc_weak_form dt")),
    Fault(
        "harness/catalogue/registry.py",
        "gravity=rotate(s.gravity[None], np.array([GROUND]))[0],",
        "",
        of(TURNED, "rk45_strong_form"),
    ),
    # metrics: errors that go away, scales that grow
    Fault(MEASURE, "drift = E - E[0] - done", "drift = 0.0 * E", ONE),
    Fault(MEASURE, "np.max(np.linalg.norm(s.r[rows] - exact.r, axis=2), axis=1)", "0.0", ONE),
    Fault(MEASURE, "so3.angle_between(s.R[rows], exact.R)", "so3.angle_between(s.R[rows], s.R[rows])", ONE),
    Fault(MEASURE, "exact = reference.states(np.minimum(t[rows], reference.horizon))", "exact = s.at(rows)", ONE),
    Fault(MEASURE, "if reaction is None or", "if reaction is not None or", ONE),
    Fault("harness/judge/metrics/scales.py", "Scales(*(float(v) for v in", "Scales(*(float(10.0 * v) for v in", ONE),
    Fault(
        "harness/judge/metrics/reactions.py",
        "load, changed = (x.load for x in",
        "load, changed = (-x.load for x in",
        ONE,
    ),
    Fault(
        "harness/columns/declared/work.py",
        "of=lambda run: len(run.series.t) - 1,",
        "of=lambda run: len(run.series.t),",
        of(PENDULUM, "gc_weak_form dt"),
    ),
    # verdict: judges that say nothing
    Fault(
        "harness/judge/law.py",
        "            out.append(Reason(law, most, allowed, unit, when, name))\n",
        "            pass\n",
        WRONG,
    ),
    Fault(
        "harness/run/measuring.py",
        "because = list_broken_laws(problem, trajectory, measured, numbers)",
        "because = []",
        WRONG,
    ),
    Fault(
        "harness/run/measuring.py",
        "(because := find_inaccuracy(measured, numbers))",
        "(because := [])",
        INACCURATE,
    ),
    Fault("harness/mechanics/types/verdicts.py", "Law.ENERGY: 0.10", "Law.ENERGY: 1.0", WRONG),
    Fault("harness/mechanics/types/verdicts.py", '"accurate_until_s": 0.1,', '"accurate_until_s": 1.0,', TURNING),
    # references
    Fault(
        "harness/reference/newton_euler.py",
        "f[:-1, :3] = s.mass[:, None] * s.gravity",
        "f[:-1, :3] = 1.001 * s.mass[:, None] * s.gravity",
        of("spring_pendulum[t_end=0.5]", "rk45_strong_form"),
    ),
    Fault("problems/exact/lagrange_top.py", "2 * m * g * c / transverse", "1.99 * m * g * c / transverse", ONE),
    # solvers: one term, sign or factor each
    Fault(SYMBOLIC, "force = m * (b.V_dot[:3] - g)", "force = m * (b.V_dot[:3] - 0.999 * g)", ONE),
    Fault(SYMBOLIC, "+ ca.cross(Omega, J @ Omega)", "- ca.cross(Omega, J @ Omega)", TOPS),
    Fault(
        "solvers/formulations/ida.py", "rtol=control.rtol,", "rtol=100.0 * control.rtol,", of(PENDULUM, "ida_index1")
    ),
    Fault(
        METHODS + "rattle.py",
        "s.half[b, a] += 0.5 * h * (k.force[b, a] / k.mass[b])",
        "s.half[b, a] += 0.51 * h * (k.force[b, a] / k.mass[b])",
        of(PENDULUM, "rattle"),
    ),
    Fault(METHODS + "rattle.py", "copy(s.half, k.v)", "copy(k.w, k.v)  # as before the force", of(PENDULUM, "rattle")),
    Fault(
        METHODS + "alpha.py",
        "ratio * c.beta * h * h, ratio * c.gamma * h",
        "ratio * c.beta * h * h, ratio * h",
        of(PENDULUM, "generalized_alpha"),
    ),
    Fault(
        METHODS + "alpha.py", "- c.alpha_m * s.a0[b, a]", "+ c.alpha_m * s.a0[b, a]", of(PENDULUM, "generalized_alpha")
    ),
    Fault(
        "solvers/formulations/compiled/factor.py",
        "DEPENDENT = 1e-9",
        "DEPENDENT = 1e-1",
        of("four_bar_grid[t_end=1]", "rkmk_dopri5"),
    ),
    Fault("harness/base/tableaux.py", "RK45.B.copy()", "0.999 * RK45.B", of(PENDULUM, "rkmk_dopri5")),
    Fault(
        METHODS + "gc_step.py",
        "half * (v0[a] + v1[a])",
        "2.0 * half * v1[a]",
        of(PENDULUM, "gc_augmented_lagrangian"),
    ),
    Fault(
        METHODS + "gc_step.py",
        "half * (v0[3] + v1[3])",
        "0.999 * half * (v0[3] + v1[3])",
        of("torque_free_body[inertia_factors=(1,1.5,2),t_end=10]", "gc_augmented_lagrangian"),  # turns about all axes
    ),
    Fault(
        "solvers/formulations/strong_ode.py",
        '"rtol": control.rtol, "atol": atol',
        '"rtol": 0.0, "atol": 1e3 * atol',
        ONE,
    ),
)
