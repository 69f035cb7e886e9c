"""Newton's model and its steps (modules ``export.protocol`` and ``export.stepping``)."""

import importlib.metadata
import warnings
from typing import Any

import numpy as np
import warp as wp

wp.config.quiet = True
warnings.simplefilter("ignore")

import newton  # noqa: E402  below the line that keeps its import quiet

from .turning import rotate_back  # noqa: E402
from .warp_model import read_dynamics  # noqa: E402

GROUND = -1
PROBE = 1e-6  # [s] of the step after which accelerations are read


class Model:
    """A model of links and joints, in its state after the last step."""

    def __init__(self, data: dict[str, Any]) -> None:
        """Build Newton's model from the ``data`` of the protocol, and take one step, which compiles the kernels.

        Raises ValueError where Newton changes an inertia.
        """
        options, limbs = data["options"], data["limbs"]
        self._name = options["solver"]
        kind = getattr(newton.solvers, f"Solver{self._name}")
        builder = newton.ModelBuilder(gravity=tuple(data["gravity"]))
        if hasattr(kind, "register_custom_attributes"):
            kind.register_custom_attributes(builder)
        link: dict[int, int] = {GROUND: GROUND}
        joints = []
        for limb in limbs:
            link[limb["body"]] = child = builder.add_link(
                xform=_make_transform(limb["r"], limb["R"]),
                mass=limb["mass"],
                inertia=wp.mat33(*np.ravel(limb["inertia"])),
                lock_inertia=True,
            )
            if limb["kind"] == "FREE":
                joints.append(builder.add_joint_free(child))
                continue
            ends = {
                "parent": link[limb["parent"]],
                "child": child,
                "parent_xform": _make_transform(limb["s_parent"], limb["R_0"]),
                "child_xform": _make_transform(limb["s_child"], np.eye(3)),
            }
            joints.append(_add_joint(builder, limb["kind"], limb["moves"], ends))
        for root, tree in _group_trees(limbs, joints):
            builder.add_articulation(tree, label=f"tree {root}")
        self._cuts = len(data["cuts"])
        for cut in data["cuts"]:
            builder.add_joint_ball(
                parent=link[cut["j"]],
                child=link[cut["i"]],
                armature=0.0,
                parent_xform=_make_transform(cut["s_j"], np.eye(3)),
                child_xform=_make_transform(cut["s_i"], np.eye(3)),
            )
        self._model = model = builder.finalize(device="cpu")
        self._order = [link[b] for b in sorted(b for b in link if b != GROUND)]
        given = np.array([limb["inertia"] for limb in limbs], dtype=np.float32)
        if np.max(np.abs(model.body_inertia.numpy() - given)) > 1e-6 * np.max(np.abs(given)):
            raise ValueError("it changes an inertia, whose moments violate the triangle inequality")
        self._now, self._next = model.state(), model.state()
        self._now.body_q.assign(np.array([_make_transform(x["r"], x["R"]) for x in limbs], dtype=np.float32))
        turning = [np.array(x["R"]) @ x["Omega"] for x in limbs]
        motion = np.array([[*x["v"], *w] for x, w in zip(limbs, turning, strict=True)], dtype=np.float32)
        self._now.body_qd.assign(motion)
        newton.eval_ik(model, self._now, self._now.joint_q, self._now.joint_qd)
        if self._name == "Featherstone" or self._name == "MuJoCo":
            newton.eval_fk(model, self._now.joint_q, self._now.joint_qd, self._now)
        model.joint_q.assign(self._now.joint_q)
        model.joint_qd.assign(self._now.joint_qd)
        self._solver, self.stopped = self._make_solver(kind, options, data["dt"]), ""
        made_by = f"newton {importlib.metadata.version('newton')}"
        if self._name == "MuJoCo":
            below = (f"{name} {importlib.metadata.version(name)}" for name in ("mujoco", "mujoco-warp"))
            made_by += f" on {' and '.join(below)}"
        self.notes = [f"solver {self._name}, single precision, CPU", made_by]
        spare = [model.state(), model.state()]  # compilation by the first step is set-up
        spare[0].assign(self._now)
        self._solver.step(spare[0], spare[1], None, None, data["dt"])
        self._solver = self._make_solver(kind, options, data["dt"])

    def _make_solver(self, kind: Any, options: dict[str, Any], dt: float) -> Any:
        """Return Newton's solver of class ``kind`` with the options; for MuJoCo also with the softness of loops.

        Its time constant is a multiple of the step ``dt`` [s].
        """
        solver = kind(self._model, **_select_settings(self._name, options))
        if self._name == "MuJoCo" and options["settings"] == "ours" and solver.mjw_model.neq:
            loops, T, d = solver.mjw_model, options["time_constant"] * dt, options["impedance"]
            loops.eq_solref.assign(np.broadcast_to([T, 1.0], (*loops.eq_solref.shape, 2)))
            loops.eq_solimp.assign(np.broadcast_to([d, d, 1e-3, 0.5, 2.0], (*loops.eq_solimp.shape, 5)))
        return solver

    def describe_start(self) -> dict[str, Any]:
        """Return the mass matrix, constraints, and accelerations without constraints at the start, and there at rest.

        They are computed by the solver MuJoCo, whose velocities are the tree's, whatever solver is chosen.
        """
        solver = newton.solvers.SolverMuJoCo(self._model, integrator="euler")
        found = []
        for factor in (0.0, 1.0):
            before, after = self._model.state(), self._model.state()
            before.assign(self._now)
            before.joint_qd.assign(factor * self._now.joint_qd.numpy())
            solver.step(before, after, None, None, PROBE)
            found.append(read_dynamics(solver.mjw_model, solver.mjw_data, self._cuts))
        return {"rest_rates": found[0]["rates"], **found[1]}

    def advance(self, steps: int, dt: float) -> list[tuple[np.ndarray, np.ndarray]]:
        """Advance by ``steps`` steps of ``dt`` [s]; return poses and velocities (v, omega) of all bodies after each."""
        out = []
        for _ in range(steps):
            self._now.clear_forces()
            self._solver.step(self._now, self._next, None, None, dt)
            self._now, self._next = self._next, self._now
            out.append((self._now.body_q.numpy().copy(), self._now.body_qd.numpy().copy()))
        return out

    def rows(self, found: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Convert the list ``found`` of ``advance`` to rows (r, quaternion (w, x, y, z), v, Omega), body by body."""
        pose = np.array([q[self._order] for q, _ in found], dtype=float)
        twist = np.array([u[self._order] for _, u in found], dtype=float)
        p = np.roll(pose[..., 3:], 1, axis=-1)
        p /= np.linalg.norm(p, axis=-1, keepdims=True)
        out = np.concatenate((pose[..., :3], p, twist[..., :3], rotate_back(p, twist[..., 3:])), axis=-1)
        return out.reshape(len(out), -1)


def _add_joint(builder: Any, kind: str, moves: list[Any], ends: dict[str, Any]) -> int:
    """Add a joint to ``builder``; return its index.

    ``moves`` are pairs (whether it slides, axis in the joint frame); ``ends`` are the arguments parent, child and their
    frames. A joint with several moves becomes a D6 joint.
    """
    if kind == "BALL":
        return int(builder.add_joint_ball(armature=0.0, **ends))
    if kind == "FIXED":
        return int(builder.add_joint_fixed(**ends))
    if len(moves) == 1:
        ((slides, axis),) = moves
        add = builder.add_joint_prismatic if slides else builder.add_joint_revolute
        return int(add(axis=wp.vec3(*axis), armature=0.0, **ends))
    axes: dict[bool, list[Any]] = {True: [], False: []}
    for slides, axis in moves:
        axes[slides].append(builder.JointDofConfig(axis=wp.vec3(*axis), armature=0.0))
    return int(builder.add_joint_d6(linear_axes=axes[True], angular_axes=axes[False], **ends))


def _select_settings(name: str, options: dict[str, Any]) -> dict[str, Any]:
    """Return the options as keyword arguments of Newton's solver ``name``; none with settings "default"."""
    if options["settings"] == "default":
        return {}
    if name == "XPBD":
        both = options["joint_relaxation"]
        return {"iterations": options["iterations"], "joint_linear_relaxation": both, "joint_angular_relaxation": both}
    if name == "MuJoCo":
        return {"integrator": options["integrator"], "tolerance": 1e-8}
    if name == "Kamino":
        config = newton.solvers.SolverKamino.Config()
        config.padmm.max_iterations = options["max_iterations"]
        config.constraints.alpha = options["alpha"]
        return {"config": config}
    return {"angular_damping": 0.0}


def _group_trees(limbs: list[dict[str, Any]], joints: list[int]) -> list[tuple[int, list[int]]]:
    """Return (first body, indices of joints) of each tree; a limb whose parent is the ground begins a new tree."""
    out: list[tuple[int, list[int]]] = []
    for limb, joint in zip(limbs, joints, strict=True):
        if limb["parent"] == GROUND:
            out.append((limb["body"], []))
        out[-1][1].append(joint)
    return out


def _make_transform(r: Any, R: Any) -> wp.transform:
    """Return Warp's transform with position r and rotation R."""
    return wp.transform(wp.vec3(*r), wp.quat_from_matrix(wp.mat33(*np.ravel(R))))
