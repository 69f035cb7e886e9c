"""MuJoCo: joint coordinates of a tree, cut joints as soft equality constraints, its own compiled loop.

The tree is that of ``mechanics.cut_trees``: hinge, slide, ball and free joints. Each point of a cut joint is a
``connect`` constraint. MuJoCo's constraints are soft: a row with gap r, velocity v and acceleration a follows

    a + d (b v + k r) = (1 - d) a_0,   d = impedance,  b = 2/(d T),  k = 1/(d T)^2,  T = time_constant dt

with a_0 its acceleration without the constraint. A gap of about (1 - d) a_0 T^2 remains, so that with T = 2 dt errors
fall with dt^2 whatever the integrator. Trees have no such rows, and their motion has the order of the integrator.
Contacts and automatic resets are off; constant loads are actuators, springs are tendons, torsional springs about a
hinge are those of its joint.

With ``settings`` "default" the integrator, the constraint solver, solref and solimp are MuJoCo's defaults; only the
step is that of the run (MuJoCo's own is 0.002 s). Its treatment of free bodies has no option: implicitfast, implicit
and discrete treat their gyroscopic terms implicitly, Euler does not. With ``settings`` "file" the integrator, the
constraint solver, solref and solimp are those of the MJCF file from which the problem was read; at the file's timestep
this is what its author runs, and a note names any other step.
"""

import contextlib
import math
from dataclasses import dataclass, fields
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...harness.catalogue import registry
from ...harness.catalogue.mechanism import MechanismFile
from ...harness.catalogue.options import option
from ...harness.catalogue.registry import solver
from ...harness.mechanics.cut_trees.plain import flatten_tree, list_hinge_springs
from ...harness.mechanics.cut_trees.tree import DRIVES, EngineTree, Kind, build_spanning_tree
from ...harness.mechanics.joints import JointKind, MovingKind
from ...harness.mechanics.system import GROUND
from ...harness.mechanics.types import Problem, States, Status, StepControl, Trajectory
from ..formulations.packages import find_remedy
from ..formulations.recording import Clock, ClockedSolver
from .export.engine import VARYING, SupportedElements, import_package, refuse_unsupported
from .export.march import PartialStretch, march
from .export.model_check import EngineModel, refuse_model

INTEGRATORS = {  # order in dt without constraints
    "RK4": 4.0,
    "Euler": 1.0,
    "implicitfast": 1.0,
    "implicit": 1.0,
    "discrete": 1.0,
}
LACKS: dict[str, str] = {
    **dict.fromkeys((*DRIVES, MovingKind.DRIVEN_DISTANCE), "it has actuators and no prescribed motion"),
    JointKind.DISTANCE: "a tendon holds its length softly",
    MovingKind.ROLLING: "its contacts are soft",
    "rack and pinion": "it couples coordinates softly",
    VARYING: "controls are constant within a step",
}
CONSTRAINT_SOLVERS = ("Newton", "CG", "PGS")
WRONG_IF_SPARSE = "4.0.0"  # factors its Hessian wrongly: google-deepmind/mujoco#3767, right from 4.0.1


@solver("mujoco")
@dataclass(frozen=True)
class MuJoCo(ClockedSolver):
    """MuJoCo's integrators in joint coordinates, with soft constraints at cut joints."""

    integrator: str = option("RK4", "MuJoCo's name of it; Euler is semi-implicit", choices=tuple(INTEGRATORS))
    constraint_solver: str = option("Newton", "solver of the soft constraints", choices=CONSTRAINT_SOLVERS)
    iterations: int = option(100, "most iterations of the constraint solver", at_least=1)
    tolerance: float = option(1e-14, "tolerance of the constraint solver: MuJoCo's relative improvement", at_least=0.0)
    time_constant: float = option(
        2.0, "time constant of the soft constraints, in steps; MuJoCo allows no less than 2", at_least=2.0
    )
    settings: str = option(
        "ours",
        "integrator and loops; ours: the options above; default: as MuJoCo ships them; file: as in the problem's file",
        choices=("ours", "default", "file"),
    )
    impedance: float = option(
        0.9999, "impedance of the soft constraints; MuJoCo allows 0.0001 to 0.9999", at_least=1e-4, at_most=0.9999
    )

    own_angles: ClassVar[bool] = True
    name: ClassVar[str]
    paper_label: ClassVar[str] = ""
    control: ClassVar[str] = "dt"
    takes: ClassVar[SupportedElements] = SupportedElements(loads="constant", lacks=LACKS)

    @property
    def order(self) -> float:
        """Order of the integrator, which loops reduce to at most 2; NaN with the settings of a file."""
        if self.settings == "file":
            return math.nan
        return INTEGRATORS[self.integrator if self.settings == "ours" else "Euler"]

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why MuJoCo cannot integrate the problem, or None.

        Causes: MuJoCo is missing, elements that it does not have, options that ``settings`` overrides, or a model that
        differs from this project's equations.
        """
        if (reason := find_remedy("mujoco") or refuse_unsupported(problem.system, self.takes)) is not None:
            return reason
        if (reason := self._describe_ignored()) is not None:
            return reason
        if self.settings == "file" and (reason := _refuse_file_settings(problem)) is not None:
            return reason
        try:
            model = Model(self, problem, control)
        except ValueError as error:  # raised by its compiler, e.g. for an inertia that no body can have
            return f"MuJoCo does not take the model: {' '.join(str(error).split())}"
        return refuse_model(self.name, problem, model.describe_start())

    def _describe_ignored(self) -> str | None:
        """Return a refusal that names the options which the chosen ``settings`` override, or None."""
        own = [f for f in fields(self) if f.name != "settings"]
        ignored = [f.name for f in own if self.settings != "ours" and getattr(self, f.name) != f.default]
        if not ignored:
            return None
        whose = "the file" if self.settings == "file" else "MuJoCo as it ships"
        return f"settings={self.settings} takes {', '.join(ignored)} from {whose}: leave {', '.join(ignored)} out"

    def _integrate(self, problem: Problem, control: StepControl, clock: Clock) -> Trajectory:
        """Integrate by MuJoCo's own loop (``rollout``) with the fixed step ``control.dt``; return the trajectory."""
        model = Model(self, problem, control)
        return march(problem, control, model.advance, model.states, clock=clock, notes=model.notes())


class Model:
    """A compiled MuJoCo model and its state after the last step."""

    def __init__(self, options: MuJoCo, problem: Problem, control: StepControl) -> None:
        """Compile MuJoCo's model with the step ``control.dt``, and set its state to the start."""
        assert control.dt is not None  # checked by the catalogue
        self.mj = import_package("mujoco", "rollout")
        self.problem, self.tree = problem, build_spanning_tree(problem.system, problem.initial)
        self.model = _make_spec(self.mj, options, problem, self.tree, control.dt).compile()
        given = _find_file_model(problem) if options.settings == "file" else None
        own = control.dt if given is None else float(given.opt.timestep)
        is_other = abs(control.dt - own) > 1e-9 * own
        self._other_step = (f"dt = {control.dt:g} s; the file's timestep is {own:g} s",) if is_other else ()
        self.data = self.mj.MjData(self.model)
        with contextlib.suppress(PartialStretch):
            self.advance(1, control.dt)  # set-up at the first call is not counted
        self.mj.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:] = self.tree.start, self.tree.start_velocity

    def advance(self, steps: int, dt: float) -> Float[np.ndarray, "k n"]:
        """Advance by ``steps`` steps of ``dt`` [s]; return a row (time, qpos, qvel) after each.

        Raises ``PartialStretch`` where MuJoCo warns, with the rows before: after a warning ``rollout`` repeats a state.
        """
        mj, self.model.opt.timestep = self.mj, dt
        kind = mj.mjtState.mjSTATE_FULLPHYSICS
        first = np.empty(mj.mj_stateSize(self.model, kind))
        mj.mj_getState(self.model, self.data, first, kind)
        warm = self.data.qacc_warmstart.copy()
        rows, _ = mj.rollout.rollout(self.model, self.data, first[None], nstep=steps, initial_warmstart=warm[None])
        warning = next((w for w in range(mj.mjtWarning.mjNWARNING) if self.data.warning[w].number), None)
        if warning is None:
            return rows[0]
        words = mj.mju_warningText(warning, self.data.warning[warning].lastinfo)
        moved = int(np.sum(np.diff(rows[0, :, 0], prepend=first[0]) > 0.0))  # the last of them warned
        raise PartialStretch(Status.DIVERGED, f"MuJoCo warned and stopped: {words}", rows[0, : max(moved - 1, 0)])

    def states(self, rows: Float[np.ndarray, "k n"]) -> States:
        """Convert rows of ``advance`` to poses and velocities of the bodies."""
        nq = self.model.nq
        return self.tree.states(rows[:, 1 : 1 + nq], rows[:, 1 + nq : 1 + nq + self.model.nv])

    def describe_start(self) -> EngineModel:
        """Return MuJoCo's mass matrix, forces, energies and constraints at the start, for the model check.

        ``data`` has to be at the start, and is evaluated there.
        """
        mj, m, d, problem = self.mj, self.model, self.data, self.problem
        mj.mj_forward(m, d)
        mj.mj_energyPos(m, d)
        mj.mj_energyVel(m, d)
        mass_matrix = np.zeros((m.nv, m.nv))
        mj.mj_fullM(m, d, mass_matrix)
        rows = np.zeros((d.nefc, m.nv))
        if mj.mj_isSparse(m):
            mj.mju_sparse2dense(rows, d.efc_J, d.efc_J_rownnz, d.efc_J_rowadr, d.efc_J_colind)
        else:
            rows[:] = d.efc_J[: rows.size].reshape(rows.shape)
        G = np.zeros((m.neq, 3, m.nv))
        for cut in np.unique(d.efc_id):
            G[cut] = rows[d.efc_id == cut]  # MuJoCo leaves out a cut whose rows vanish, as of a joint declared twice
        G = G.reshape(-1, m.nv)
        potential, kinetic = map(float, d.energy)
        still = mj.MjData(m)
        still.qpos[:] = self.tree.start
        mj.mj_forward(m, still)
        T, bias = self.tree.jacobian(), self.tree.bias(problem.initial)
        return EngineModel(T, mass_matrix, still.qfrc_smooth, kinetic, potential, bias, d.qfrc_smooth, G)

    def notes(self) -> tuple[str, ...]:
        """Return notes for the run: tree and cut joints, integrator, a step other than the file's, MuJoCo's version."""
        cuts = len(self.tree.cuts)
        limbs = f"{len(self.tree.limbs)} bodies as a tree of {self.model.nv} velocities"
        held = f"{limbs}; {cuts} points of cut joints held by soft constraints" if cuts else limbs
        made_by = f"mujoco {self.mj.__version__}"
        if self.mj.__version__ == WRONG_IF_SPARSE and self.mj.mj_isSparse(self.model):
            made_by += ", whose accelerations can be wrong with sparse Jacobians, as here; 4.0.1 is right"
        used = self.mj.mjtIntegrator(self.model.opt.integrator).name.removeprefix("mjINT_")
        return held, f"integrator {used}", *self._other_step, made_by


def _make_spec(mj: ModuleType, options: MuJoCo, problem: Problem, tree: EngineTree, dt: float) -> Any:
    """Return the problem as an uncompiled ``MjSpec`` with the step ``dt`` [s] and the settings of the options.

    Bodies follow ``tree``; each point of a cut joint is a soft ``connect`` equality. Contacts are off.
    """
    from .inside import mjcf  # it imports MuJoCo

    system, start = problem.system, problem.initial
    spec = mj.MjSpec()
    o, off = spec.option, mj.mjtDisableBit
    o.timestep, o.gravity, o.iterations, o.tolerance = dt, system.gravity, options.iterations, options.tolerance
    o.solver = getattr(mj.mjtSolver, f"mjSOL_{options.constraint_solver.upper()}")
    o.integrator = getattr(mj.mjtIntegrator, f"mjINT_{options.integrator.upper()}")
    solref, solimp = (options.time_constant * dt, 1.0), (options.impedance, options.impedance, 1e-3, 0.5, 2)
    if options.settings != "ours":
        given = _find_file_model(problem) if options.settings == "file" else mj.MjSpec().compile()
        o.integrator, o.iterations, o.tolerance = given.opt.integrator, given.opt.iterations, given.opt.tolerance
        o.solver = given.opt.solver
        active = np.flatnonzero(given.eq_active0)
        if len(active):
            solref, solimp = given.eq_solref[active[0]], given.eq_solimp[active[0]]
        elif options.settings == "default":
            unset = mj.MjSpec().add_equality()
            solref, solimp = unset.solref, unset.solimp
    o.disableflags = off.mjDSBL_CONTACT | off.mjDSBL_AUTORESET
    spec.compiler.degree = False
    springs = list_hinge_springs(system, start, tree)
    parts = {GROUND: spec.worldbody}
    for limb in tree.limbs:
        free = limb.kind is Kind.FREE
        moments, axes = np.linalg.eigh(system.regular_inertia[limb.body])
        parts[limb.body] = part = parts[limb.parent].add_body(
            name=_name_body(limb.body),
            mass=system.mass[limb.body],
            explicitinertial=True,
            ipos=np.zeros(3),
            inertia=moments,
            iquat=_make_quaternion(axes * np.linalg.det(axes)),
            pos=start.r[limb.body] if free else limb.s_parent - limb.R_0 @ limb.s_child,
            quat=_make_quaternion(limb.R_0),
        )
        kinds = mj.mjtJoint
        if limb.kind.has_quaternion:
            part.add_joint(type=kinds.mjJNT_FREE if free else kinds.mjJNT_BALL, pos=limb.s_child)
        for slides, axis in limb.list_moves():
            kind = kinds.mjJNT_SLIDE if slides else kinds.mjJNT_HINGE
            part.add_joint(type=kind, pos=limb.s_child, axis=axis, **mjcf.make_spring(springs.get(limb.body)))
    for cut in tree.cuts:
        row = spec.add_equality(type=mj.mjtEq.mjEQ_CONNECT, objtype=mj.mjtObj.mjOBJ_BODY)
        row.name1, row.name2, row.data[:3] = _name_body(cut.i), _name_body(cut.j), cut.s_i
        row.solref, row.solimp = solref, solimp
    given = flatten_tree(tree, system, start)
    mjcf.add_springs(spec, parts, given["springs"])
    mjcf.add_loads(spec, parts, given["loads"])
    return spec


def _find_file_model(problem: Problem) -> Any:
    """Return MuJoCo's compiled model of the MJCF file from which the problem was read, or None if there is none."""
    entry = registry.problems().get(problem.name)
    made_by_file = getattr(getattr(entry, "make", None), "__self__", None)
    return getattr(made_by_file, "model", None) if isinstance(made_by_file, MechanismFile) else None


def _refuse_file_settings(problem: Problem) -> str | None:
    """Return why ``settings`` "file" cannot be used, or None: no MJCF file, or equalities of different softness."""
    given = _find_file_model(problem)
    if given is None:
        return "settings=file: the problem was not read from an MJCF file"
    active = np.flatnonzero(given.eq_active0)
    if any(np.ptp(a[active], axis=0).any() for a in (given.eq_solref, given.eq_solimp) if len(active)):
        return "settings=file: its equalities differ in solref or solimp"
    return None


def _name_body(body: int) -> str:
    """Return the name of the body of index ``body`` in MuJoCo's model; "world" for the ground."""
    return "world" if body == GROUND else f"body {body}"


def _make_quaternion(R: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, " 4"]:
    """Return the quaternion (w, x, y, z) of a rotation matrix."""
    return Rotation.from_matrix(R).as_quat(scalar_first=True)
