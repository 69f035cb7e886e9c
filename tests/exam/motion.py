"""True motions over their time, kept in a folder; energies, sizes and distances by formulas of their own."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.integrate import DOP853

from .building import Declared
from .truth import RTOL, Equations, turned

INSTANTS = 100  # at which rows and loads are compared
BEYOND = 1.5  # of its time: a motion that is told too fast needs what comes after
Bodies = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # r, R, v, w (space) along times


@dataclass(frozen=True)
class Truth:
    """The true motion between the steps of DOP853, by its own polynomials."""

    equations: Equations
    t: np.ndarray  # (steps + 1,)
    y: np.ndarray  # (steps, ny) at the start of each
    F: np.ndarray  # (steps, 7, ny)

    def values(self, t: np.ndarray) -> np.ndarray:
        """y at the times (nt, ny)."""
        k = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.y) - 1)
        x = ((t - self.t[k]) / (self.t[k + 1] - self.t[k]))[:, None]
        out = np.zeros((len(t), self.y.shape[1]))
        for i in range(self.F.shape[1]):
            out = (out + self.F[k, -1 - i]) * (x if i % 2 == 0 else 1.0 - x)
        return out + self.y[k]

    def bodies(self, t: np.ndarray) -> Bodies:
        """Poses and velocities at the times."""
        parts = [self.equations.parts(y)[:4] for y in self.values(t)]
        r, R, v, w = (np.array(x) for x in zip(*parts, strict=True))
        return r, R, v, w

    def loads(self, t: np.ndarray) -> np.ndarray:
        """Sums of the joints' loads on each body (nt, n, 6): force in space, moment about C in the body."""
        out = []
        for time, y in zip(t, self.values(t), strict=True):
            y = self.equations.project(time, y)
            load = self.equations.accelerations(time, y)[1]
            load[:, 3:] = turned(np.swapaxes(self.equations.parts(y)[1], 1, 2), load[:, 3:])
            out.append(load)
        return np.array(out)


def integrate(d: Declared) -> Truth:
    """The true motion from the start to ``BEYOND`` times ``t_end``."""
    e = Equations(d)
    y = e.start()
    reach = float(np.ptp(d.r - d.r[0])) + float(np.max(np.linalg.norm(np.array([j.s_i for j in d.joints]), axis=1)))
    reach = max(reach, 1e-3 * float(np.max(np.abs(d.v), initial=0.0)) * d.t_end, 1e-9)
    rate = max(float(np.max(np.abs(d.w), initial=0.0)), 1.0 / d.t_end)
    n = e.n
    stiff = max((np.sqrt(x.stiffness / e.mass[x.i]) for x in d.springs), default=0.0)
    faster = 1.0 + 1e-3 * stiff / rate  # velocities of stiff springs are known no better than rounding leaves them
    parts = ((3 * n, reach), (4 * n, 1.0), (3 * n, faster * reach * rate), (3 * n, faster * rate))
    size = np.concatenate([np.full(k, x) for k, x in parts])
    size = np.concatenate((size, np.ones(len(d.torsions))))
    y = e.project(0.0, y)
    route = DOP853(e.rate, 0.0, y, BEYOND * d.t_end, rtol=RTOL, atol=RTOL * size, first_step=1e-5 * d.t_end)
    t, ys, Fs = [0.0], [], []
    while route.status == "running":
        words = route.step()
        if route.status == "failed":
            raise RuntimeError(f"no true motion beyond {route.t:g} s: {words}")
        piece = route.dense_output()
        t.append(route.t)
        ys.append(piece.y_old)
        Fs.append(piece.F)
        route.y = e.project(route.t, route.y)
        route.f = e.rate(route.t, route.y)
    return Truth(e, np.array(t), np.array(ys), np.array(Fs))


def true_motion(name: str, d: Declared, folder: Path) -> Truth:
    """The true motion, from ``folder`` where it was computed by this very code."""
    here = Path(__file__).parent
    code = b"".join(p.read_bytes() for p in sorted(here.glob("*mechanisms.py")))
    code += b"".join((here / name).read_bytes() for name in ("building.py", "truth.py", "motion.py"))
    path = folder / f"{name}-{hashlib.sha256(code).hexdigest()[:16]}.npz"
    if path.is_file():
        with np.load(path) as kept:
            e = Equations(d)
            e.accelerations(0.0, e.start())  # sets the rank
            return Truth(e, kept["t"], kept["y"], kept["F"])
    found = integrate(d)
    folder.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part.npz")
    np.savez(part, t=found.t, y=found.y, F=found.F)
    part.replace(path)
    return found


def energy(d: Declared, wound: np.ndarray, s: Bodies) -> tuple[np.ndarray, np.ndarray]:
    """T, and V of gravity and springs, along times; ``wound`` (nt, torsions) [rad] from rest."""
    r, R, v, w = s
    mass, J = np.array([b.mass for b in d.bodies]), np.array([b.inertia for b in d.bodies])
    Omega = turned(np.swapaxes(R, -1, -2), w)
    T = 0.5 * np.sum(mass * np.sum(v * v, axis=-1) + np.einsum("tbi,bij,tbj->tb", Omega, J, Omega), axis=1)
    V = -np.einsum("b,tbi,i->t", mass, r - d.r, d.gravity)
    for x in d.springs:
        ends = [
            np.array(p, dtype=float) if k < 0 else r[:, k] + turned(R[:, k], np.array(p, dtype=float))
            for k, p in ((x.i, x.p_i), (x.j, x.p_j))
        ]
        V = V + 0.5 * x.stiffness * (np.linalg.norm(ends[0] - ends[1], axis=-1) - x.rest_length) ** 2
    for x, angle in zip(d.torsions, wound.T, strict=True):
        V = V + 0.5 * x.stiffness * angle**2
    return T, V


def gyration(d: Declared) -> np.ndarray:
    """Radius of gyration of each body [m]."""
    return np.array([np.sqrt(np.trace(b.inertia) / (2.0 * b.mass)) for b in d.bodies])


def displacement(d: Declared, a: Bodies, b: Bodies) -> np.ndarray:
    """Root mean square distance of each body's matter (nt, n) [m]: |r - r'|^2 + tr(D S D^T) / m, D = R - R'."""
    S = np.array([(0.5 * np.trace(x.inertia) * np.eye(3) - x.inertia) / x.mass for x in d.bodies])
    D = a[1] - b[1]
    turn = np.einsum("tbij,bjk,tbik->tb", D, S, D)
    return np.sqrt(np.sum((a[0] - b[0]) ** 2, axis=-1) + np.maximum(turn, 0.0))


def rate_distance(d: Declared, a: Bodies, b: Bodies) -> np.ndarray:
    """How far velocities of bodies are apart (nt, n) [m/s], rotations by the radius of gyration."""
    square = np.sum((a[2] - b[2]) ** 2, axis=-1) + gyration(d) ** 2 * np.sum((a[3] - b[3]) ** 2, axis=-1)
    return np.sqrt(square)
