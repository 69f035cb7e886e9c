"""Generate code of a mechanism in joint coordinates y = (q, u), each function for many states by one call.

rate        y_dot of the motion, q_dot = T(q) u
tangent     its derivative along a direction: the variational equations
project     y onto unit quaternions, phi = 0 and phi_dot = 0: one Newton step of least change in kinetic energy
frame       T, H of 2 T_kin = u^T H u, and the slopes of (phi, phi_dot) along (T xi, eta)
bodies      r, R, v, Omega of all bodies in space
"""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ...base.generated import Code
from ...base.generated.code import print_functions
from ...catalogue.offers import find_offer
from ...mechanics.joint_expressions import ExpressionWriter, JointExpressions
from ...mechanics.joint_tree import Tree
from ...mechanics.state import States
from ...mechanics.system import MultibodySystem
from .lanes import LANES, pack_lanes, unpack_lanes, vectorise_functions

if TYPE_CHECKING:
    from ...base.generated import Loop

VERSION = 5  # of cached code: increase it when ``_write_functions`` changes
ARGUMENTS = {"about": 2, "rate": 4, "tangent": 5, "project": 4, "frame": 6, "bodies": 7}


class FlowEquations:
    """The functions of the module, compiled for a mechanism, on arrays with states along the first axis."""

    def __init__(self, system: MultibodySystem, tree: Tree) -> None:
        """Write and compile the functions, or take them from the cache; raise ValueError for unsuitable mechanisms."""
        writer: ExpressionWriter = find_offer("expressions")
        self.system, self.tree = system, tree
        self.ny, self.nu = tree.nq + tree.nu, tree.nu
        key = f"shadow {VERSION}\0{writer.digest(system, tree)}"  # ValueError for mechanisms that it refuses
        self._code = Code(lambda: _print_code(_write_functions(writer.write(system, tree))), key)
        self._functions = {name: self._code.function(name, n) for name, n in ARGUMENTS.items()}
        about = np.zeros(1)
        self._call("about", 1, about)
        self.rows = int(about[0])  # independent rows of phi and phi_dot
        self.freedom = 2 * self.nu - self.rows

    def _call(self, name: str, n: int, *arrays: np.ndarray) -> None:
        """Call the machine code of the function ``name`` for ``n`` states, with the memory of ``arrays``."""
        count = np.array([n], dtype=np.int64)
        self._functions[name](count.ctypes.data, *(a.ctypes.data for a in arrays))

    def _map(self, name: str, t: np.ndarray, y: np.ndarray, *outputs: np.ndarray) -> None:
        """Call the machine code of ``name`` for the states ``y`` at times ``t`` [s]; it fills the ``outputs``."""
        self._call(name, len(y), np.ascontiguousarray(t), np.ascontiguousarray(y), *outputs)

    def evaluate_rate(self, t: Float[np.ndarray, " n"], y: Float[np.ndarray, "n ny"]) -> Float[np.ndarray, "n ny"]:
        """Return y_dot of the motion at the states ``y`` at times ``t`` [s]."""
        lanes = [pack_lanes(a[None])[0] for a in (t[:, None], y)]
        out = np.empty(lanes[1].shape)
        self._call("rate", len(out), *lanes, out)
        return unpack_lanes(out[None], len(y))[0]

    def evaluate_tangent(
        self, t: Float[np.ndarray, " n"], y: Float[np.ndarray, "n ny"], Y: Float[np.ndarray, "n m ny lanes"]
    ) -> Float[np.ndarray, "n m ny lanes"]:
        """Return the derivative of y_dot at each state ``y`` along its directions ``Y``: m groups of ``LANES``."""
        x, Y = np.repeat(np.column_stack((t, y))[:, :, None], LANES, axis=2), np.ascontiguousarray(Y)
        first = np.repeat(np.arange(len(y), dtype=np.int64) * x.shape[1], Y.shape[1])
        out = np.empty(Y.shape)
        self._call("tangent", len(first), Y, x, first, out)
        return out

    def project(self, t: Float[np.ndarray, " n"], y: Float[np.ndarray, "n ny"]) -> Float[np.ndarray, "n ny"]:
        """Return the states after one Newton step onto unit quaternions and closed loops, phi = phi_dot = 0."""
        out = np.empty(y.shape)
        self._map("project", t, y, out)
        return out

    def evaluate_frame(
        self, t: Float[np.ndarray, " n"], y: Float[np.ndarray, "n ny"]
    ) -> tuple[Float[np.ndarray, "n nq nu"], Float[np.ndarray, "n nu nu"], Float[np.ndarray, "n rows two_nu"]]:
        """Return T of q_dot = T u, H of 2 T_kin = u^T H u, and the slopes of (phi, phi_dot) along (T xi, eta)."""
        n, nu = len(y), self.nu
        T, H, G = np.empty((n, nu, self.tree.nq)), np.empty((n, nu, nu)), np.empty((n, 2 * nu, self.rows))
        self._map("frame", t, y, T, H, G)  # matrices are stored by columns
        return np.swapaxes(T, 1, 2), H, np.swapaxes(G, 1, 2)

    def evaluate_bodies(self, t: Float[np.ndarray, " n"], y: Float[np.ndarray, "n ny"]) -> States:
        """Return poses and velocities of all bodies, in space, at each state."""
        shape = (len(y), self.system.nb, 3)
        r, R, v, Omega = np.empty(shape), np.empty((*shape, 3)), np.empty(shape), np.empty(shape)
        self._map("bodies", t, y, r, R, v, Omega)
        return States(r, R, v, Omega, t)


def _print_code(functions: "dict[str, Loop]") -> str:
    """Return the LLVM IR of the functions; ``rate`` and ``tangent`` handle ``LANES`` states at a time.

    These two are removed from ``functions``.
    """
    vector = vectorise_functions(print_functions({name: functions.pop(name) for name in ("rate", "tangent")}))
    return print_functions(functions) + vector


def _write_functions(e: JointExpressions) -> "dict[str, Loop]":
    """Return the functions of the module's list as symbolic loops over states, and ``about``, which counts the rows."""
    import casadi as ca

    from ...base.generated import Loop

    t, y, nu = e.t, e.y, e.H.shape[0]
    dy, x = ca.SX.sym("dy", y.numel()), ca.SX.sym("x", 1 + y.numel())
    along = ca.substitute(ca.jtimes(e.rate, y, dy), ca.vertcat(t, y), x)
    slopes = ca.jacobian(e.gaps, y) @ ca.diagcat(e.T, ca.SX.eye(nu))
    v, Omega = (ca.vertcat(*(e.V[k + at : k + at + 3] for k in range(0, e.V.numel(), 6))) for at in (0, 3))

    def of_state(*outputs: ca.SX) -> Loop:
        """Return a loop that stores ``outputs`` for each state (t, y)."""
        return Loop(rows=[t, y], stored=[ca.densify(ca.vec(a)) for a in outputs])

    return {
        "about": Loop(stored=[ca.SX(e.gaps.numel())]),
        "rate": of_state(e.rate),
        "tangent": Loop(rows=[dy], blocks=[x], stored=[ca.densify(along)]),
        "project": of_state(e.closed),
        "frame": of_state(e.T, e.H, slopes),
        "bodies": of_state(e.r, e.R, v, Omega),
    }
