"""Convert a mechanism that MuJoCo has read and compiled (module ``mechanism_files``) to a system and its start.

Bodies without joints of their own are parts of their parent. A body's joints make one joint here::

    hinge  revolute          slide, hinge along it  cylindrical     slide, ball            point on line
    slide  prismatic         hinge, hinge normal    universal       slide, slide, ball     point on plane
    ball   spherical         three hinges           spherical       slide, slide, hinge    three points on a plane
    free, or slide, slide, slide, ball: none

Equality constraints close loops: a connect is spherical, two of the same bodies are revolute, a weld is fixed. A tendon
between two sites is a spring. Other forces are omitted and counted (``OmittedContents``); elements that would change
which motions are possible are an error.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from ...catalogue.mechanism import MechanismFile
from ...catalogue.options import Parameter
from ...mechanics.consistency import START_TOLERANCE, project
from ...mechanics.joints import Joint, JointKind
from ...mechanics.naming import name_part
from ...mechanics.state import State
from ...mechanics.system import GROUND, MultibodySystem, RigidBody, SpringDamper, TorsionSpring, assemble
from ...mechanics.types import Problem
from .mujoco_bodies import NO_INERTIA, group_bodies
from .rates import DIGITS, complete_velocities, describe_open_joint

T_END = 2.0  # [s] default end of motions, since files have none
BEHIND = 100.0  # [m] distance behind the body at which springs of slides begin, so that their length stays positive
NEAR = 1e-9  # tolerance for directions and points that must agree, in files printed with all digits


class OmittedContents(StrEnum):
    """The kinds of contents of a file that are omitted."""

    ACTUATORS = "actuators"
    COLLIDING = "colliding geoms"
    LIMITS = "limits"
    STIFFNESS = "other springs of joints"
    DAMPING = "other dampers of joints"
    FRICTION = "dry friction"
    ARMATURE = "armatures of axes that move"
    LIFT = "bodies with gravity compensation"
    FLUID = "fluid"
    TENDONS = "tendons other than straight springs"
    MOCAP = "mocap bodies, which stand still here"
    ASLEEP = "bodies asleep at the start, which move here"


@dataclass(frozen=True)
class CompiledMechanism(MechanismFile):
    """A file that MuJoCo has compiled. Each body here is a group of MuJoCo's bodies that no joint separates."""

    mj: Any
    model: Any
    omitted: Mapping[str, int]  # number of omitted parts, by their kind
    locked: int = 0  # joints that are fixed since their limits are equal
    roots: tuple[int, ...] = field(init=False)  # for each of our bodies the first of MuJoCo's

    @cached_property
    def _joint_choice(self) -> "ConvertedJoints":
        """The joints of MuJoCo, by number, whose springs, dampers and armatures are included."""
        return find_joints(self.mj, self.model)

    def __post_init__(self) -> None:
        roots = sorted({*map(int, group_bodies(self.model))} - {0})
        object.__setattr__(self, "roots", tuple(roots))

    @property
    def doc(self) -> str:
        """The source of the problem: the file, MuJoCo's version, locked joints, and what was omitted."""
        return self._describe(f"MuJoCo {self.mj.__version__}{describe_locked_joints(self.locked)}", self.omitted)

    def parameters(self) -> dict[str, tuple[Any, Parameter]]:
        """Return the parameters of the start: MuJoCo's ``qpos`` and ``qvel``, and ``keyframe`` if one has a name."""
        m, keys = self.model, tuple(self.model.key(k).name for k in range(self.model.nkey))
        out: dict[str, tuple[Any, Parameter]] = {
            "qpos": (tuple(map(float, m.qpos0)), Parameter("the start in MuJoCo's coordinates", "m, rad")),
            "qvel": ((0.0,) * m.nv, Parameter("its velocities", "m/s, rad/s")),
        }
        if any(keys):
            words = "start at this keyframe, where qpos and qvel are not given"
            out["keyframe"] = ("none", Parameter(words, choices=("none", *filter(None, keys))))
        return out

    def problem(self, **given: Any) -> Problem:
        """Return the problem from ``qpos`` and ``qvel`` or a ``keyframe`` in ``given``, or from the file's own start.

        ``qpos`` and ``qvel`` that differ from their defaults replace those of the keyframe. Where equality constraints
        close loops, the start is projected onto them. If they are open by more than printed digits explain, raise
        ValueError if ``qpos`` was given or velocities are not 0; any other start is moved all the same, and the
        problem's source says so.
        """
        m, key = self.model, given.get("keyframe", "none")
        start = {"qpos": tuple(map(float, m.qpos0)), "qvel": (0.0,) * m.nv}
        if key != "none":
            start |= {name: tuple(getattr(m.key(key), name)) for name in start}
            at = self._place_model(m.qpos0)
            moved = np.ravel(m.key(key).mpos) - at.mocap_pos.ravel(), np.ravel(m.key(key).mquat) - at.mocap_quat.ravel()
            if m.neq and np.max(np.abs(np.concatenate(moved)), initial=0.0) > NEAR:
                raise ValueError(f"keyframe {key!r} places mocap bodies elsewhere, which is not supported; give qpos")
        start |= {
            name: given[name]
            for name, (default, _) in self.parameters().items()
            if name in start and given.get(name, default) != default
        }
        system, initial = self.system(start["qpos"]), self.state(**start)
        source = self.doc
        if m.neq and (gap := describe_open_joint(system, initial)):
            if any(start["qvel"]) or start["qpos"] == given.get("qpos") != tuple(map(float, m.qpos0)):
                raise ValueError(f"{gap}; give qpos that closes its loops")
            source += f"; {gap} and moved onto its loops"
        return Problem(
            self.name,
            system,
            self._close_loops(system, initial, **start) if m.neq else initial,
            t_end=T_END,
            dt=float(m.opt.timestep),
            section="",
            source=source,
        )

    def _close_loops(self, system: MultibodySystem, given: State, qpos: Any, qvel: Any) -> State:
        """Return the start ``given`` projected onto its loops; velocities of 0 are replaced by what the others require.

        ``qpos`` and ``qvel`` are MuJoCo's coordinates and velocities of that start.
        """
        out, rates = project(system, given), np.array(qvel)
        speeds = [np.concatenate((s.v.ravel(), s.Omega.ravel())) for s in (given, out)]
        if np.max(np.abs(speeds[1] - speeds[0])) <= max(DIGITS * np.max(np.abs(speeds[0])), START_TOLERANCE):
            return out
        each = [self.state(qpos, tuple(e)) for e in np.eye(len(rates))]  # velocities of bodies by each of ``qvel``
        rows = np.linalg.pinv(np.array([np.column_stack((s.v, s.Omega)).ravel() for s in each]).T)
        return project(system, complete_velocities(system, out, rows, rates, "qvel", DIGITS))

    def state(self, qpos: tuple[float, ...], qvel: tuple[float, ...]) -> State:
        """Return the state of the bodies at MuJoCo's coordinates ``qpos`` and velocities ``qvel``."""
        mj, m, d = self.mj, self.model, self._place_model(qpos)
        r, R = self._find_poses(d)
        both = np.zeros((len(r), 2, 3))
        for n, root in enumerate(self.roots):
            T = np.zeros((2, 3, m.nv))  # Jacobians of the velocity of C and of the angular velocity
            mj.mj_jac(m, d, T[0], T[1], r[n], root)
            both[n] = T @ np.array(qvel)
        return State(r, R, both[:, 0], np.einsum("bji,bj->bi", R, both[:, 1]))

    def system(self, qpos: tuple[float, ...] | None = None) -> MultibodySystem:
        """Return the system with joints at MuJoCo's reference coordinates and springs wound as at ``qpos``.

        By default ``qpos`` is the reference. Equality constraints and gravity that a flag disables are left out.
        """
        m, d, off = self.model, self._place_model(self.model.qpos0), self.mj.mjtDisableBit
        r, R = self._find_poses(d)
        frames = _BodyFrames(
            np.concatenate((r, np.zeros((1, 3)))), np.concatenate((R, np.eye(3)[None])), d, self._number_bodies()
        )
        loops = [] if m.opt.disableflags & off.mjDSBL_EQUALITY else self._make_loop_joints(frames)
        weightless = bool(m.opt.disableflags & off.mjDSBL_GRAVITY)
        return assemble(
            [self._make_body(n, d, r[n], R[n]) for n in range(len(self.roots))],
            [j for n in range(len(self.roots)) for j in self._make_joints(n, frames)] + loops,
            np.zeros(3) if weightless else np.array(m.opt.gravity),
            [*self._make_tendon_springs(frames), *self._make_slide_springs(frames)],
            torsions=self._make_hinge_springs(frames, self.model.qpos0 if qpos is None else np.array(qpos)),
        )

    def _place_model(self, qpos: Any) -> Any:
        """Return MuJoCo's data with the poses and centres of mass of all bodies at the coordinates ``qpos``."""
        d = self.mj.MjData(self.model)
        d.qpos[:] = qpos
        self.mj.mj_kinematics(self.model, d)
        self.mj.mj_comPos(self.model, d)
        return d

    def _number_bodies(self) -> list[int]:
        """Return, for each of MuJoCo's bodies, the number of our body that contains it."""
        number = {0: GROUND, **{root: n for n, root in enumerate(self.roots)}}
        return [number[int(w)] for w in group_bodies(self.model)]

    def _find_poses(self, d: Any) -> tuple[Float[np.ndarray, "nb 3"], Float[np.ndarray, "nb 3 3"]]:
        """Return the centre of mass of each of our bodies [m, space], and its frame: that of its root in MuJoCo."""
        m, group = self.model, group_bodies(self.model)
        r = [np.average(d.xipos[group == w], axis=0, weights=m.body_mass[group == w]) for w in self.roots]
        return np.array(r).reshape(-1, 3), d.xmat[list(self.roots)].reshape(-1, 3, 3)

    def _make_body(self, n: int, d: Any, r: np.ndarray, R: np.ndarray) -> RigidBody:
        """Return our body ``n``, with mass and inertia of MuJoCo's bodies in its group, and armatures of its hinges.

        Its centre of mass is ``r`` [m, space], its frame ``R``; ``d`` has the poses of MuJoCo's bodies.
        """
        m, J = self.model, np.zeros((3, 3))
        parts = np.flatnonzero(group_bodies(m) == self.roots[n])
        for b in parts:
            principal, s = d.ximat[b].reshape(3, 3), d.xipos[b] - r
            values = np.where(m.body_inertia[b] > NO_INERTIA, m.body_inertia[b], 0.0)
            J += (principal * values) @ principal.T + m.body_mass[b] * (s @ s * np.eye(3) - np.outer(s, s))
        armature = sum(
            float(self.model.dof_armature[m.jnt_dofadr[k]])
            for k in self._joint_choice.armatures
            if m.jnt_bodyid[k] == self.roots[n]
        )
        J = R.T @ J @ R + armature * np.eye(3)  # about an axis at rest only the inertia about that axis matters
        return RigidBody(float(np.sum(m.body_mass[parts])), 0.5 * (J + J.T), m.body(self.roots[n]).name)

    def _make_joints(self, n: int, frames: "_BodyFrames") -> list[Joint]:
        """Return the joints that replace MuJoCo's between our body ``n`` and its parent, as listed in the module.

        They are one, or three points on a plane, or none for a free body. Raise ValueError for other combinations.
        """
        m, d, root = self.model, frames.data, self.roots[n]
        own = range(m.body_jntadr[root], m.body_jntadr[root] + m.body_jntnum[root])
        letters = "".join("FBSH"[m.jnt_type[k]] for k in own)  # free, ball, slide, hinge
        points, axes = [d.xanchor[k] for k in own], [d.xaxis[k] for k in own]
        name = "+".join(m.joint(k).name or m.body(root).name for k in own)
        parent = frames.ours[m.body_parentid[root]]

        def make_joint(kind: JointKind, p: np.ndarray, i: Any = None, j: Any = None, across: Any = None) -> Joint:
            """Return the joint at point ``p`` [m] with axes i and j and a direction across them, all given in space."""
            to_body, to_parent = frames.make_converter(n), frames.make_converter(parent)
            return Joint(
                n,
                frames.convert_point(n, p),
                parent,
                frames.convert_point(parent, p),
                to_body(i),
                to_parent(j),
                name,
                kind,
                to_body(across),
                to_parent(across),
            )

        one_point = all(np.linalg.norm(p - points[-1]) < NEAR for p in points)
        along = [abs(float(a @ axes[-1])) for a in axes[:-1]]
        match letters:
            case "F" | "SSSB":
                return []
            case "B":
                return [make_joint(JointKind.SPHERICAL, points[0])]
            case "HHH" if one_point and abs(np.linalg.det(axes)) > NEAR:
                return [make_joint(JointKind.SPHERICAL, points[0])]
            case "H":
                return [make_joint(JointKind.REVOLUTE, points[0], axes[0], axes[0])]
            case "S":
                return [make_joint(JointKind.PRISMATIC, points[0], axes[0], axes[0], _choose_normal(axes[0]))]
            case "HH" if one_point and along[0] < NEAR:
                return [make_joint(JointKind.UNIVERSAL, points[0], axes[1], axes[0])]
            case "SH" | "HS" if along[0] > 1.0 - NEAR:
                return [make_joint(JointKind.CYLINDRICAL, points[letters.index("H")], axes[0], axes[0])]
            case "SB":
                return [make_joint(JointKind.ON_LINE, points[1], None, axes[0])]
            case "SSB":
                return [make_joint(JointKind.ON_PLANE, points[2], None, np.cross(axes[0], axes[1]))]
            case "SSH" if max(along) < NEAR:
                e = _choose_normal(axes[2])
                corners = (points[2], points[2] + e, points[2] + np.cross(axes[2], e))
                return [make_joint(JointKind.ON_PLANE, p, None, axes[2]) for p in corners]
        kinds = ", ".join({"F": "free", "B": "ball", "S": "slide", "H": "hinge"}[c] for c in letters)
        raise ValueError(
            f"body {m.body(root).name!r}: its joints ({kinds}) are together no supported joint; give each "
            "a body of its own, with mass and inertia, one within the other"
        )

    def _make_loop_joints(self, frames: "_BodyFrames") -> list[Joint]:
        """Return the joints of active equality constraints, which close loops; raise ValueError for other kinds.

        A connect is spherical, two between the same bodies are one revolute joint, a weld is fixed.
        """
        m, eq = self.model, self.mj.mjtEq
        fixed, points_of = list[Joint](), dict[tuple[int, int], list[Joint]]()
        for k in np.flatnonzero(m.eq_active0):
            kind, ends, data = eq(m.eq_type[k]), (m.eq_obj1id[k], m.eq_obj2id[k]), m.eq_data[k]
            if kind not in (eq.mjEQ_CONNECT, eq.mjEQ_WELD):
                what = kind.name.removeprefix("mjEQ_").lower()
                raise ValueError(
                    f"{name_part('equality', int(k), m.equality(k).name)}: couplings of type {what} are not "
                    "supported (connect and weld are); remove it, or make one of its joints part of its parent"
                )
            if m.eq_objtype[k] == int(self.mj.mjtObj.mjOBJ_SITE):
                bodies, points = [m.site_bodyid[e] for e in ends], [m.site_pos[e] for e in ends]
                turns = [_convert_quaternion(self.mj, m.site_quat[e]) for e in ends]
            else:
                weld = kind == eq.mjEQ_WELD
                bodies, points = list(ends), [data[3:6], data[:3]] if weld else [data[:3], data[3:6]]
                turns = [_convert_quaternion(self.mj, data[6:10]) if weld else np.eye(3), np.eye(3)]
            sides = [frames.convert_end(b, p, q) for b, p, q in zip(bodies, points, turns, strict=True)]
            (i, s_i, R_i), (j, s_j, R_j) = sides[::-1] if sides[0][0] == GROUND else sides
            name = m.equality(k).name or f"loop {k}"
            weld = kind == eq.mjEQ_WELD and data[10] != 0.0  # torquescale: without it no moment acts
            if i == j:
                if np.linalg.norm(s_i - s_j) < NEAR and not (weld and np.linalg.norm(R_i - R_j) > NEAR):
                    continue  # it holds whatever moves
                raise ValueError(f"equality {name}: it joins {m.body(bodies[0]).name!r} to itself")
            if weld:
                z_x = R_i[:, 2], R_j[:, 2], name, JointKind.FIXED, R_i[:, 0], R_j[:, 0]
                fixed.append(Joint(i, s_i, j, s_j, *z_x))
            else:
                points_of.setdefault((i, j), []).append(Joint(i, s_i, j, s_j, name=name))
        return fixed + [joint for same in points_of.values() for joint in _merge_hinges(same)]

    def _make_tendon_springs(self, frames: "_BodyFrames") -> list[SpringDamper]:
        """Return the springs with dampers of tendons that are straight between two bodies."""
        m, out = self.model, []
        for k in filter(lambda k: is_straight_spring(self.mj, m, k), range(m.ntendon)):
            sites = m.wrap_objid[m.tendon_adr[k] : m.tendon_adr[k] + 2]
            sides = [frames.convert_end(m.site_bodyid[s], m.site_pos[s], np.eye(3))[:2] for s in sites]
            (i, p_i), (j, p_j) = sides[::-1] if sides[0][0] == GROUND else sides
            if i != j:
                k_c = float(m.tendon_stiffness[k]), float(m.tendon_damping[k])
                out.append(SpringDamper(i, p_i, j, p_j, k_c[0], float(m.tendon_lengthspring[k, 0]), k_c[1]))
        return out

    def _make_hinge_springs(self, frames: "_BodyFrames", qpos: np.ndarray) -> list[TorsionSpring]:
        """Return the torsional springs with dampers of hinges, wound as at ``qpos``; 0 is the reference coordinate."""
        m, out = self.model, []
        for k in sorted({*self._joint_choice.turning_springs, *self._joint_choice.turning_dampers}):
            n = frames.ours[m.jnt_bodyid[k]]
            parent = frames.ours[m.body_parentid[self.roots[n]]]
            axis = frames.data.xaxis[k]
            across = _choose_normal(axis)
            stiffness = float(m.jnt_stiffness[k]) if k in self._joint_choice.turning_springs else 0.0
            damping = float(m.dof_damping[m.jnt_dofadr[k]]) if k in self._joint_choice.turning_dampers else 0.0
            to_body, to_parent = frames.make_converter(n), frames.make_converter(parent)
            out.append(
                TorsionSpring(
                    n,
                    to_body(across),
                    parent,
                    to_parent(axis),
                    to_parent(across),
                    stiffness,
                    self._find_rest(k),
                    damping,
                    self._count_turns(k, qpos),
                )
            )
        return out

    def _make_slide_springs(self, frames: "_BodyFrames") -> list[SpringDamper]:
        """Return the springs with dampers of slides, each from a point of the axis far behind the body (``BEHIND``)."""
        m, out = self.model, []
        for k in sorted({*self._joint_choice.sliding_springs, *self._joint_choice.sliding_dampers}):
            n = frames.ours[m.jnt_bodyid[k]]
            parent = frames.ours[m.body_parentid[self.roots[n]]]
            far = BEHIND * (1.0 + abs(self._find_rest(k)))
            points = [frames.data.xanchor[j] for j in range(m.njnt) if m.jnt_bodyid[j] == m.jnt_bodyid[k]]
            here = points[-1]  # point of the hinge or ball that slides along the axis
            p_i, p_j = frames.convert_point(n, here), frames.convert_point(parent, here - far * frames.data.xaxis[k])
            stiffness = float(m.jnt_stiffness[k]) if k in self._joint_choice.sliding_springs else 0.0
            damping = float(m.dof_damping[m.jnt_dofadr[k]]) if k in self._joint_choice.sliding_dampers else 0.0
            out.append(SpringDamper(n, p_i, parent, p_j, stiffness, far + self._find_rest(k), damping))
        return out

    def _count_turns(self, k: int, qpos: np.ndarray) -> int:
        """Return by how many turns, rounded, hinge ``k`` at ``qpos`` is wound from the rest of its spring."""
        at = self.model.jnt_qposadr[k]
        return round(float(qpos[at] - self.model.qpos_spring[at]) / (2.0 * np.pi))

    def _find_rest(self, k: int) -> float:
        """Return the coordinate [m or rad] of joint ``k``, from the reference one, at which its spring is at rest."""
        at = self.model.jnt_qposadr[k]
        return float(self.model.qpos_spring[at] - self.model.qpos0[at])


def describe_locked_joints(joints: int) -> str:
    """Return the note, for a problem's source, on how many joints are fixed by equal limits; empty for none."""
    return f", joints fixed by equal limits: {joints}" if joints else ""


@dataclass(frozen=True)
class ConvertedJoints:
    """The joints of MuJoCo's model, by number, whose springs, dampers and armatures have a counterpart here."""

    turning_springs: tuple[int, ...]
    turning_dampers: tuple[int, ...]
    sliding_springs: tuple[int, ...]
    sliding_dampers: tuple[int, ...]
    armatures: tuple[int, ...]


def find_joints(mj: Any, m: Any) -> ConvertedJoints:
    """Return the joints of model ``m`` whose springs, dampers and armatures have a counterpart here.

    They are hinges about an axis that both bodies share, and slides along a line that contains a point of the body.
    Their springs and dampers must be linear. An armature counts if the axis of its hinge is at rest, where it is an
    inertia of the body; between moving bodies it is the inertia of a rotor that no rigid body of the file has.
    """
    hinge, slide = int(mj.mjtJoint.mjJNT_HINGE), int(mj.mjtJoint.mjJNT_SLIDE)
    turning, sliding, still, group = [], [], [], group_bodies(m)
    for k in range(m.njnt):
        own = [j for j in range(m.njnt) if m.jnt_bodyid[j] == m.jnt_bodyid[k]]
        letters = "".join("FBSH"[m.jnt_type[j]] for j in own)
        if m.jnt_type[k] == hinge and letters in ("H", "SH", "HS", "SSH"):
            turning.append(k)
            grounded = group[m.body_parentid[m.jnt_bodyid[k]]] == 0
            still += [k] if grounded else []
        elif m.jnt_type[k] == slide and letters in ("S", "SH", "SB", "HS"):
            sliding.append(k)

    def select_linear(joints: list[int], values: np.ndarray, nonlinear: np.ndarray) -> tuple[int, ...]:
        """Return those of ``joints`` whose value is not zero and whose ``nonlinear`` coefficients are."""
        return tuple(k for k in joints if values[k] != 0.0 and not np.any(nonlinear[k]))

    first = m.jnt_dofadr
    damping, nonlinear = m.dof_damping[first], m.dof_dampingpoly[first]
    return ConvertedJoints(
        select_linear(turning, m.jnt_stiffness, m.jnt_stiffnesspoly),
        select_linear(turning, damping, nonlinear),
        select_linear(sliding, m.jnt_stiffness, m.jnt_stiffnesspoly),
        select_linear(sliding, damping, nonlinear),
        select_linear(still, m.dof_armature[first], np.zeros(m.njnt)),
    )


@dataclass(frozen=True)
class _BodyFrames:
    """Poses of our bodies, the ground last, to which points and directions of space are converted."""

    r: Float[np.ndarray, "places 3"]  # [m, space]
    R: Float[np.ndarray, "places 3 3"]
    data: Any  # MuJoCo's poses at the reference coordinates
    ours: list[int]  # number of our body for each of MuJoCo's

    def convert_point(self, n: int, p: np.ndarray) -> np.ndarray:
        """Return the point ``p`` [m, space] in the frame of our body ``n``."""
        out: np.ndarray = self.R[n].T @ (p - self.r[n])
        return out

    def make_converter(self, n: int) -> Callable[[Any], Any]:
        """Return a function that converts a direction from space to the frame of our body ``n``; None stays None."""
        return lambda a: None if a is None else self.R[n].T @ a

    def convert_end(self, b: int, p: np.ndarray, turn: np.ndarray) -> tuple[int, np.ndarray, np.ndarray]:
        """Return the number of our body that contains MuJoCo's body ``b``, and a point and axes of b in its frame.

        ``p`` [m] and ``turn`` (columns are the axes) are given in the frame of b.
        """
        n, Rb = self.ours[b], self.data.xmat[b].reshape(3, 3)
        return n, self.convert_point(n, self.data.xpos[b] + Rb @ p), self.R[n].T @ Rb @ turn


def is_straight_spring(mj: Any, m: Any, k: int) -> bool:
    """Return whether tendon ``k`` of model ``m`` is a linear spring or damper between two sites.

    A range of rest lengths, within which it has no force, is not linear.
    """
    first, site = m.tendon_adr[k], int(mj.mjtWrap.mjWRAP_SITE)
    plain = m.tendon_num[k] == 2 and all(m.wrap_type[first : first + 2] == site)
    linear = not np.any(m.tendon_stiffnesspoly[k]) and not np.any(m.tendon_dampingpoly[k])
    return bool(plain and linear and m.tendon_lengthspring[k, 0] == m.tendon_lengthspring[k, 1])


def _merge_hinges(same: list[Joint]) -> list[Joint]:
    """Return one revolute joint in place of two spherical ones between the same bodies; its axis joins their points.

    Any other number of joints is returned unchanged, as are points that coincide or differ in distance on the bodies.
    """
    if len(same) != 2:
        return same
    a, b = same
    in_i, in_j = np.subtract(b.s_i, a.s_i), np.subtract(b.s_j, a.s_j)
    if np.linalg.norm(in_i) < NEAR or abs(np.linalg.norm(in_i) - np.linalg.norm(in_j)) > NEAR:
        return same
    return [Joint(a.i, a.s_i, a.j, a.s_j, in_i, in_j, f"{a.name}+{b.name}")]


def _choose_normal(a: np.ndarray) -> np.ndarray:
    """Return a unit vector normal to ``a``."""
    n = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
    out: np.ndarray = n / np.linalg.norm(n)
    return out


def _convert_quaternion(mj: Any, quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation matrix of a quaternion (w, x, y, z)."""
    out = np.zeros(9)
    mj.mju_quat2Mat(out, quaternion)
    return out.reshape(3, 3)
