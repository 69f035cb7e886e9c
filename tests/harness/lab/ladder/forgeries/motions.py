"""An honest solver of one body on a spherical joint, and ways to falsify its motion."""

import dataclasses
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from mbsbench import Problem, States, Status, StepControl, Trajectory

Change = Callable[[Trajectory, Problem], object]


def swing(
    p: Problem,
    control: StepControl,
    *,
    gravity: float = 1.0,
    inertia: float = 1.0,
    gyroscopic: float = 1.0,
    pinned: bool = True,
    scale: float = 1.0,
) -> Trajectory:
    """Euler's equation about the joint by RK4, at steps of ``dt``; factors of its terms are 1 for the true motion."""
    s = p.system
    arm, joint = s.joint_s_i[0], s.joint_s_j[0]  # from C to the joint, in the body; the joint, in space
    m, J = s.mass[0], inertia * (s.inertia[0] + s.mass[0] * (arm @ arm * np.eye(3) - np.outer(arm, arm)))
    n = max(round(p.t_end / control.dt), 1)
    h = p.t_end / n

    def rate(R: np.ndarray, w: np.ndarray) -> np.ndarray:
        torque = np.cross(-arm, m * gravity * (R.T @ s.gravity)) if pinned else np.zeros(3)
        return np.linalg.solve(J, torque - gyroscopic * np.cross(w, J @ w))

    def turn(R: np.ndarray, w: np.ndarray) -> np.ndarray:
        return R @ np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])

    R, w = p.initial.R[0], scale * p.initial.Omega[0]
    Rs, ws = [R], [w]
    for _ in range(n):
        a1, b1 = turn(R, w), rate(R, w)
        a2, b2 = turn(R + h / 2 * a1, w + h / 2 * b1), rate(R + h / 2 * a1, w + h / 2 * b1)
        a3, b3 = turn(R + h / 2 * a2, w + h / 2 * b2), rate(R + h / 2 * a2, w + h / 2 * b2)
        a4, b4 = turn(R + h * a3, w + h * b3), rate(R + h * a3, w + h * b3)
        R, w = R + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4), w + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
        U, _, V = np.linalg.svd(R)
        R = U @ V
        Rs.append(R)
        ws.append(w)
    R, w, t = np.array(Rs), np.array(ws), h * np.arange(n + 1)
    r = joint - R @ arm
    v = np.einsum("tij,tj->ti", R, np.cross(w, -arm))
    states = States(r[:, None], R[:, None], v[:, None], w[:, None])
    return Trajectory(t, states, Status.SUCCESS, "reached the end", {"steps": n}, pull(p, t, R, r, v))


def pull(p: Problem, t: np.ndarray, R: np.ndarray, r: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The force of the joint on the body, m (a - g), in space, as the row force conjugate to phi = r + R s - O."""
    return p.system.mass[0] * (np.gradient(v, t, axis=0) - p.system.gravity)


def states(found: Trajectory, **changed: np.ndarray) -> Trajectory:
    """With other states."""
    return dataclasses.replace(found, states=dataclasses.replace(found.states, **changed))


def rows(found: Trajectory, chosen: object, t: np.ndarray | None = None) -> Trajectory:
    """Some rows, at other times ``t``."""
    reaction = None if found.reaction is None else found.reaction[chosen]
    return dataclasses.replace(
        found, t=found.t[chosen] if t is None else t, states=found.states.at(chosen), reaction=reaction
    )


def smooth(a: np.ndarray, width: int = 61) -> np.ndarray:
    """A moving mean along time, ends kept."""
    out = a.copy()
    half = width // 2
    for k in range(half, len(a) - half):
        out[k] = a[k - half : k + half + 1].mean(axis=0)
    return out


def at_end(a: np.ndarray, change: np.ndarray | float) -> np.ndarray:
    """A change that grows along time."""
    return a + np.linspace(0.0, 1.0, len(a)).reshape(-1, *[1] * (a.ndim - 1)) * change


def poisoned(a: np.ndarray, value: float) -> np.ndarray:
    """One value in the middle."""
    out = a.copy()
    out[len(a) // 2] = value
    return out


TURN = Rotation.from_rotvec([0.3, -0.2, 0.4]).as_matrix()
PUBLIC = {"mass": 1.0, "l": 0.5, "g": 9.81}


def stored(found: Trajectory, p: Problem) -> Trajectory:
    """The motion of the public numbers, along -Y, whatever was asked."""
    t = found.t / found.t[-1] * 0.5
    angle = -0.5 * PUBLIC["g"] / PUBLIC["l"] * t**2
    R = Rotation.from_rotvec(np.outer(angle, [0, 0, 1])).as_matrix()[:, None]
    r = PUBLIC["l"] * R[:, :, :, 0]
    w = np.gradient(angle, t)[:, None, None] * np.array([0.0, 0.0, 1.0])
    return states(found, r=r, R=R, v=np.gradient(r, t, axis=0), Omega=np.broadcast_to(w, r.shape).copy())


def cut(found: Trajectory, p: Problem) -> Trajectory:
    return rows(found, slice(0, len(found.t) // 2))


def still(found: Trajectory, p: Problem) -> Trajectory:
    """The start, all along."""
    return dataclasses.replace(found, states=found.states.at(np.zeros(len(found.t), dtype=int)), reaction=None)


def with_energy(found: Trajectory, p: Problem) -> Trajectory:
    """A motion with too little gravity, its velocities rescaled so that the energy is constant."""
    bad = swing(p, StepControl(dt=float(found.t[1])), gravity=0.7)
    s, sys = bad.states, p.system
    T = 0.5 * sys.mass[0] * np.sum(s.v[:, 0] ** 2, -1) + 0.5 * np.einsum(
        "ti,ij,tj->t", s.Omega[:, 0], sys.inertia[0], s.Omega[:, 0]
    )
    V = -sys.mass[0] * s.r[:, 0] @ sys.gravity
    factor = np.sqrt(np.maximum(T[0] + V[0] - V, 1e-12) / T)[:, None, None]
    return states(bad, v=s.v * factor, Omega=s.Omega * factor)


def again(p: Problem, found: Trajectory, **factors: object) -> Trajectory:
    return swing(p, StepControl(dt=float(found.t[1])), **factors)  # type: ignore[arg-type]


def mirrored(a: np.ndarray) -> np.ndarray:
    return a * np.array([-1.0, 1.0, 1.0])


MOTIONS: dict[str, Change] = {
    "the start, all along": still,
    "two rows that are the start": lambda f, p: dataclasses.replace(still(rows(f, [0, -1]), p), t=f.t[[0, -1]]),
    "velocities reversed": lambda f, p: states(f, v=-f.states.v, Omega=-f.states.Omega),
    "velocities reversed after the start": lambda f, p: states(
        f,
        v=np.concatenate([f.states.v[:1], -f.states.v[1:]]),
        Omega=np.concatenate([f.states.Omega[:1], -f.states.Omega[1:]]),
    ),
    "rotations frozen": lambda f, p: states(f, R=np.repeat(f.states.R[:1], len(f.t), axis=0)),
    "positions frozen": lambda f, p: states(f, r=np.repeat(f.states.r[:1], len(f.t), axis=0)),
    "velocities scaled": lambda f, p: states(f, v=1.3 * f.states.v, Omega=1.3 * f.states.Omega),
    "velocities scaled after the start": lambda f, p: states(
        f, v=at_end(f.states.v, 0.3 * f.states.v), Omega=at_end(f.states.Omega, 0.3 * f.states.Omega)
    ),
    "velocities smoothed": lambda f, p: states(f, v=smooth(f.states.v), Omega=smooth(f.states.Omega)),
    "velocities set to zero": lambda f, p: states(f, v=0.0 * f.states.v, Omega=0.0 * f.states.Omega),
    "spin scaled": lambda f, p: states(f, Omega=at_end(f.states.Omega, 0.3 * f.states.Omega)),
    "spin in the space frame": lambda f, p: states(f, Omega=np.einsum("tbij,tbj->tbi", f.states.R, f.states.Omega)),
    "energy rescaled": with_energy,
    "gravity too small": lambda f, p: again(p, f, gravity=0.7),
    "gravity reversed": lambda f, p: again(p, f, gravity=-1.0),
    "no gravity": lambda f, p: again(p, f, gravity=0.0),
    "inertia doubled": lambda f, p: again(p, f, inertia=2.0),
    "no gyroscopic torque": lambda f, p: again(p, f, gyroscopic=0.0),
    "another start": lambda f, p: again(p, f, scale=1.1),
    "the joint opens": lambda f, p: states(f, r=at_end(f.states.r, p.system.joint_s_i[0] * 0.3)),
    "drift of all poses": lambda f, p: states(f, r=f.states.r + p.system.joint_s_i[0]),
    "turned by a constant": lambda f, p: states(f, r=f.states.r @ TURN.T, R=TURN @ f.states.R, v=f.states.v @ TURN.T),
    "the mirror image": lambda f, p: states(f, r=mirrored(f.states.r), v=mirrored(f.states.v)),
    "a reflection for a rotation": lambda f, p: states(f, R=-f.states.R),
    "matrices that are no rotations": lambda f, p: states(f, R=at_end(f.states.R, 0.05 * f.states.R)),
    "other units of length": lambda f, p: states(f, r=2.0 * f.states.r, v=2.0 * f.states.v),
    "other units of time": lambda f, p: states(f, v=2.0 * f.states.v, Omega=2.0 * f.states.Omega),
    "a slower clock": lambda f, p: rows(f, (np.arange(len(f.t)) * 0.8).astype(int), f.t),
    "the motion of the public numbers": stored,
    "half of the motion": cut,
    "half of the motion, stretched": lambda f, p: dataclasses.replace(
        cut(f, p), t=np.linspace(0.0, p.t_end, len(f.t) // 2)
    ),
    "past the end": lambda f, p: dataclasses.replace(f, t=1.5 * f.t),
    "a row of NaN": lambda f, p: states(f, r=poisoned(f.states.r, np.nan)),
    "a row of infinity": lambda f, p: states(f, v=poisoned(f.states.v, np.inf)),
    "a jump in the middle": lambda f, p: states(f, r=poisoned(f.states.r, 0.0)),
    "times that run back": lambda f, p: dataclasses.replace(f, t=poisoned(f.t, 0.0)),
    "every row twice": lambda f, p: rows(f, np.repeat(np.arange(len(f.t)), 2)),
    "reactions scaled": lambda f, p: dataclasses.replace(f, reaction=3.0 * f.reaction),
    "reactions scaled, poses a little aside": lambda f, p: dataclasses.replace(
        states(f, r=f.states.r + 0.002 * p.system.joint_s_i[0] * (f.t > 0.0)[:, None, None]), reaction=1.5 * f.reaction
    ),
    "reactions of the other sign": lambda f, p: dataclasses.replace(f, reaction=-f.reaction),
    "reactions of zero": lambda f, p: dataclasses.replace(f, reaction=0.0 * f.reaction),
    "reactions in another order": lambda f, p: dataclasses.replace(f, reaction=np.roll(f.reaction, 1, axis=1)),
    "reactions without measure": lambda f, p: dataclasses.replace(f, reaction=1e12 + 0.0 * f.reaction),
    "a status of its own": lambda f, p: dataclasses.replace(f, status="success!"),
    "no trajectory": lambda f, p: {"status": "success"},
    "another number of bodies": lambda f, p: states(
        f, **{k: np.repeat(getattr(f.states, k), 2, axis=1) for k in ("r", "R", "v", "Omega")}
    ),
    "counters below zero to 400 digits": lambda f, p: dataclasses.replace(f, counters={"steps": -(10**400)}),
    "a time below zero": lambda f, p: dataclasses.replace(f, cpu_time=-5.0),
    "a time of 31 years": lambda f, p: dataclasses.replace(f, cpu_time=1e9),
    "set-up of 31 years": lambda f, p: dataclasses.replace(f, setup_time=1e9),
}
