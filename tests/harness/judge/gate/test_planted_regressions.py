"""The gate turns red when a solver gets worse: a sign, a step doubled, a tolerance loosened, a term dropped.

The B term of Eq. (71) exists in the geometrically consistent steps alone; in the others the gyroscopic torque
Omega x J Omega is the term that depends on velocity and is lost as easily.
"""

import dataclasses
import inspect
import textwrap
from pathlib import Path

import pytest

from mbsbench.harness.catalogue import registry
from mbsbench.harness.catalogue.suites.suite import load_suite
from mbsbench.harness.judge.gate.baseline import FOLDER, read_thresholds
from mbsbench.harness.judge.gate.check import find_worst_verdict, judge_runs
from mbsbench.harness.judge.gate.thresholds import Thresholds
from mbsbench.harness.mechanics.system import MultibodySystem
from mbsbench.harness.mechanics.types import Status, StepControl
from mbsbench.harness.results import store
from mbsbench.harness.results.findings import Verdict
from mbsbench.harness.run.job import Job
from mbsbench.solvers.formulations import symbolic, system_elements
from mbsbench.solvers.formulations.compiled import kernel, soft_rows
from mbsbench.solvers.formulations.joint_coordinates import code, motion
from mbsbench.solvers.formulations.methods.choices import GaugeChoices
from mbsbench.tests.covering import every, few
from mbsbench.tests.factories import run_here

SUITE = load_suite("ci")
THRESHOLDS = read_thresholds(FOLDER / "ci.toml")
MOVING = "spherical_pendulum[omega_z=3,t_end=5]"  # spatial and loaded: every term of the equations counts
WORSE_OPTIONS = {  # of solvers that have such an option; a solver without one is tested by its step or tolerance
    "gc_weak_form": [{"b_term": False}, {"tolerance": 1e-3}, {"gauge": "accumulate"}],
    "gc_augmented_lagrangian": [{"b_term": False}, {"tolerance": 1e-3}],
    "ida_index1": [{"alpha": 0.0, "beta": 0.0}],
    "ndf_index1": [{"alpha": 0.0, "beta": 0.0}],
    "radau_index1": [{"alpha": 0.0, "beta": 0.0}],
    "generalized_alpha": [{"rho_inf": 0.2}],
}


def run_of(solver: str, begins: str = MOVING):
    return next(c for c in SUITE.specs if c.solver == solver and c.case.startswith(begins) and not c.options)


def planted():
    for solver, entry in registry.solvers().items():
        if not any(c.solver == solver for c in SUITE.specs):
            continue
        spec = run_of(solver)
        c = spec.control
        worse = StepControl(dt=2.0 * c.dt) if c.dt else StepControl(rtol=10.0 * c.rtol)
        yield pytest.param(spec, dataclasses.replace(spec, control=worse), id=f"{solver}-{entry.control}")
        for options in WORSE_OPTIONS.get(solver, []):
            known = {k: v for k, v in options.items() if k in entry.parameters}
            if known:
                yield pytest.param(spec, dataclasses.replace(spec, options=known), id=f"{solver}-{next(iter(known))}")


def state_of(spec, run, folder: Path) -> Verdict:
    """The gate's words when the code makes ``run`` of ``spec``."""
    record = run_here(Job(run, store.create_folder(folder)))
    assert record.status != Status.CRASHED, record.message  # a gate red for a bug of ours proves nothing
    record = dataclasses.replace(record, case=spec.case, settings_id=spec.settings_id)
    bounds = tuple(b for b in THRESHOLDS.bounds if b.case == spec.case)
    return find_worst_verdict(judge_runs([spec], [record], Thresholds("ci", bounds)))


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("spec", "worse"), list(planted()))
def test_a_planted_regression_closes_the_gate(spec, worse, tmp_path):
    """Each is a change of a line that every other check may let through."""
    assert state_of(spec, worse, tmp_path) is Verdict.FAILED


@pytest.mark.parametrize("solver", every(sorted({c.solver for c in SUITE.specs}), 4))  # ``make gate`` runs all of them
def test_the_unchanged_solver_passes(solver, tmp_path):
    """The counterpart: the same run, as it is, is open."""
    assert state_of(run_of(solver), run_of(solver), tmp_path) is Verdict.MET


TOP = "heavy_top[t_end=1]"  # spins: the gyroscopic torque is what holds it up
GYROSCOPIC = "+ ca.cross(Omega, J @ Omega)"  # in solvers/formulations/symbolic.py


def changed(function, module, old: str, new: str):
    """The function as if that part of its source were another."""
    source = textwrap.dedent(inspect.getsource(function))
    assert old in source  # else nothing is planted
    names: dict = {}
    exec(source.replace(old, new), vars(module), names)
    return names[function.__name__]


def classical_with(monkeypatch, new: str) -> None:
    """The symbolic route with another gyroscopic term."""
    broken = changed(symbolic.make_body_element, symbolic, GYROSCOPIC, new)
    monkeypatch.setattr(system_elements, "make_body_element", broken)


def joints_with(monkeypatch, new: str) -> None:
    """Joint coordinates with another gyroscopic term, and code of their own."""
    broken = changed(motion.TreeMotion.compute_carried_loads, motion, "+ ca.cross(omega, spin)", new)
    monkeypatch.setattr(motion.TreeMotion, "compute_carried_loads", broken)
    monkeypatch.setattr(code, "_digest_generator", lambda: f"planted {new}")
    monkeypatch.setattr(code, "SMALL", 0)  # all stages of a step as one function take seconds to compile


def geometric_with(monkeypatch, **change: float) -> None:
    """The geometric route with a factor in its kernels changed."""
    sound = GaugeChoices.make_settings
    monkeypatch.setattr(GaugeChoices, "make_settings", lambda self, problem: sound(self, problem)._replace(**change))


ON_KERNEL = (
    "al_index3",
    "energy_momentum",
    "generalized_alpha",
    "half_explicit",
    "lie_variational",
    "radau_ggl",
    "rattle",
    "rkmk_dop853",
    "rkmk_dopri5",
)


def kernel_with(monkeypatch, factor: float) -> None:
    """The kernel by loops with J Omega times ``factor``, its inverse as it is."""
    sound = kernel.allocate_kernel

    def broken(system: MultibodySystem) -> kernel.Kernel:
        k = sound(system)
        k.J[:] *= factor
        return k

    for module in (kernel, soft_rows):
        monkeypatch.setattr(module, "allocate_kernel", broken)


CHANGED = [(solver, planted) for solver in sorted({c.solver for c in SUITE.specs}) for planted in ("sign", "dropped")]
DROPPED = ("rattle", "rattle_joint", "gc_weak_form", "gc_composed", "ida_index1")  # one of each way to change a line


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("solver", "planted"), few(CHANGED, lambda case: case[1] == "sign" or case[0] in DROPPED))
def test_a_changed_line_closes_the_gate(solver, planted, monkeypatch, tmp_path):
    """A sign turned or a term dropped in the source of each solver."""
    if solver in ON_KERNEL:
        kernel_with(monkeypatch, {"sign": -1.0, "dropped": 0.0}[planted])
        spec = run_of(solver, TOP)
    elif solver.endswith("_joint"):
        joints_with(monkeypatch, {"sign": "- ca.cross(omega, spin)", "dropped": ""}[planted])
        spec = run_of(solver, TOP)
    elif solver.startswith("gc_"):
        broken = {"sign": {"b_term": -1.0}, "dropped": {"b_term": 0.0}}[planted]
        if solver in ("gc_composed", "gc_extrapolated") and planted == "dropped":  # without B the step stays symmetric
            broken = {"gauge": 0.0}
        geometric_with(monkeypatch, **broken)
        spec = run_of(solver)
    else:
        classical_with(monkeypatch, {"sign": GYROSCOPIC.replace("+", "-"), "dropped": ""}[planted])
        spec = run_of(solver, TOP)
    assert state_of(spec, spec, tmp_path) is Verdict.FAILED


def test_every_solver_is_in_the_gate():
    """A solver that no run uses can break unseen; engines are optional, so the gate cannot ask for them."""
    ours = {n for n, e in registry.solvers().items() if e.make.__module__.rpartition(".")[0] == "mbsbench.solvers"}
    assert ours == {c.solver for c in SUITE.specs}
