"""OpenSim's model and Simbody's steps (module ``export.protocol``).

A cylindrical or universal joint is two joints with a massless body between them. Ball and free joints have body-fixed
x-y-z angles, singular where the second is 90 degrees: z of a ball's frames is along the arm of the child, x normal to
the plane in which gravity pulls the arm. Points of cut joints are point constraints, onto which steps are projected.
"""

from typing import Any

import numpy as np
import opensim as osim

from .turning import find_arm_and_normal, make_matrices

PARTS = 10  # parts of the time to t_end: limits are checked between them, Simbody cannot be stopped within one


class Model:
    """An OpenSim model, its present state, and the manager of its integrator."""

    def __init__(self, data: dict[str, Any]) -> None:
        """Build OpenSim's model from the ``data`` of the protocol, at the start; ValueError if OpenSim refuses."""
        self._data, self.stopped = data, ""
        osim.Logger.setLevelString("off")
        self._model = model = osim.Model()
        model.setUseVisualizer(False)
        model.setGravity(osim.Vec3(*data["gravity"]))
        self._bodies: dict[int, Any] = {-1: model.getGround()}
        self._driven: list[tuple[Any, dict[str, Any]]] = []
        self._joints: list[tuple[dict[str, Any], list[Any], np.ndarray]] = []
        for limb in data["limbs"]:
            self._add_limb(limb)
        # dampers become expressions, which have no energy in OpenSim
        dampers = any(spring["damping"] for spring in data["springs"])
        self._states_energy = not (dampers or any(limb["torsion"] for limb in data["limbs"]))
        for k, spring in enumerate(data["springs"]):
            ends = [x for b in ("i", "j") for x in (self._bodies[spring[b]], osim.Vec3(*spring[f"p_{b}"]))]
            if spring["damping"]:
                law = f"({spring['stiffness']!r}*(d-{spring['rest_length']!r})+{spring['damping']!r}*ddot)"
                names = [self._bodies[spring[b]].getAbsolutePathString() for b in ("i", "j")]
                force = osim.ExpressionBasedPointToPointForce(names[0], ends[1], names[1], ends[3], law)
            else:
                force = osim.PointToPointSpring(*ends, spring["stiffness"], spring["rest_length"])
            force.setName(f"spring_{k}")
            model.addForce(force)
        for k, load in enumerate(data["loads"]):
            self._add_load(k, load)
        for k, cut in enumerate(data["cuts"]):
            ends = [x for b in ("i", "j") for x in (self._bodies[cut[b]], osim.Vec3(*cut[f"s_{b}"]))]
            constraint = osim.PointConstraint(*ends)
            constraint.setName(f"cut_{k}")
            model.addConstraint(constraint)
        for k, link in enumerate(data["links"]):
            (one, p), (two, s) = ((self._bodies[link[b]], osim.Vec3(*link[f"s_{b}"])) for b in ("i", "j"))
            if link["length"]:
                constraint = osim.ConstantDistanceConstraint(two, s, one, p, link["length"])
            else:
                constraint = osim.PointOnLineConstraint(two, osim.Vec3(*link["axis"]), s, one, p)
            constraint.setName(f"link_{k}")
            model.addConstraint(constraint)
        try:
            self._state = model.initSystem()
        except RuntimeError as error:  # raised by its checks, e.g. for an inertia that no body can have
            raise ValueError(" ".join(str(error).split())) from None
        self._find_indices()
        self._set_start(np.array(data["start_velocity"]))
        self._manager, self._time = None, 0.0
        options = data["options"]
        accuracy = "as it comes" if options["settings"] == "default" else f"{data['rtol']:g}"
        self.notes = [
            f"{options['integrator']}, accuracy {accuracy}, stops at every tenth of the time",
            f"opensim {osim.GetVersion()}",
        ]

    def describe_start(self) -> dict[str, Any]:
        """Return fields of ``EngineModel`` at the start by name, in velocities of the tree.

        Forces are M u_dot + G^T lambda of the constrained motion. The potential energy is None where OpenSim has none.
        """
        model, state, matter = self._model, self._state, self._model.getMatterSubsystem()
        u = np.array(self._data["start_velocity"])
        loads = []
        for rates in (0.0 * u, u):
            self._set_start(rates)
            model.realizeAcceleration(state)
            M, G = osim.Matrix(), osim.Matrix()
            matter.calcM(state, M)
            matter.calcG(state, G)
            mass, rows = M.to_numpy(), G.to_numpy().reshape(-1, state.getNU())
            multipliers = state.getMultipliers().to_numpy() if len(rows) else np.zeros(0)
            loads.append(mass @ state.getUDot().to_numpy() + rows.T @ multipliers)
        V = self._V
        drives = [np.eye(len(u))[limb["u_at"] : limb["u_at"] + 1] for _, limb in self._driven]
        return {
            "mass_matrix": V.T @ mass @ V,
            "rest_forces": V.T @ loads[0],
            "forces": V.T @ loads[1],
            "constraints": np.concatenate((rows @ V, *drives)),
            "kinetic": model.calcKineticEnergy(state),
            "potential": model.calcPotentialEnergy(state) if self._states_energy else None,
        }

    def advance(self, steps: int, dt: float) -> Any:
        """Advance to the next tenth of ``t_end``; return OpenSim's states: the present one, then one after each step.

        ``steps`` and ``dt`` of the protocol are ignored. ``stopped`` is set to the reason of a failure.
        """
        options, t_end = self._data["options"], self._data["t_end"]
        part = min(PARTS, int(self._time / t_end * PARTS + 0.5) + 1)
        self._time = t_end * part / PARTS
        for coordinate, _ in self._driven:
            coordinate.setIsPrescribed(self._state, True)
        manager = osim.Manager(self._model)
        manager.setIntegratorMethod(getattr(osim.Manager, f"IntegratorMethod_{options['integrator']}"))
        if options["settings"] != "default":
            manager.setIntegratorAccuracy(self._data["rtol"])
        if options["constraint_tolerance"]:
            manager.setIntegratorConstraintTolerance(options["constraint_tolerance"])
        manager.setPerformAnalyses(False)
        manager.setWriteToStorage(False)
        manager.setRecordStatesTrajectory(True)
        manager.initialize(self._state)
        try:
            self._state = osim.State(manager.integrate(self._time))
        except RuntimeError as error:
            self.stopped = " ".join(str(error).split())
        self._manager = manager
        return manager.getStatesTrajectory()

    def rows(self, made: Any) -> np.ndarray:
        """Convert the states ``made`` by ``advance`` to rows (t, q, u) of the tree, one after each step."""
        y = [
            np.concatenate(([s.getTime()], s.getQ().to_numpy(), s.getU().to_numpy()))
            for s in (made.get(k) for k in range(1, made.getSize()))
        ]
        nq, nu = self._state.getNQ(), self._state.getNU()
        all_y = np.array(y).reshape(-1, 1 + nq + nu)
        all_y = all_y[np.diff(all_y[:, 0], prepend=-1.0) > 0.0]
        q, u = self._convert_to_tree(all_y[:, 1 : 1 + nq], all_y[:, 1 + nq :])
        return np.concatenate((all_y[:, :1], q, u), axis=1)

    def _add_limb(self, limb: dict[str, Any]) -> None:
        """Add a limb of the tree to the model: its body, the joints that carry it, their drive and torsional spring.

        Between two joints there is a massless body.
        """
        name, kind, J = f"body_{limb['body']}", limb["kind"], np.array(limb["inertia"])
        inertia = osim.Inertia(*np.diag(J), J[0, 1], J[0, 2], J[1, 2])
        body = osim.Body(name, limb["mass"], osim.Vec3(0), inertia)
        self._model.addBody(body)
        self._bodies[limb["body"]] = body
        inner, place, turned = self._bodies[limb["parent"]], np.array(limb["s_parent"]), np.array(limb["R_0"])
        end, coordinates, A = np.array(limb["s_child"]), [], np.eye(3)
        if kind in ("BALL", "FIXED", "FREE"):
            if kind == "BALL":
                z, x = find_arm_and_normal(limb, self._data["gravity"])
                A = np.stack((x, np.cross(z, x), z), axis=1)
            if kind == "FREE":
                place, turned = np.array(limb["r"]), np.array(limb["R"])
            make = {"BALL": osim.BallJoint, "FIXED": osim.WeldJoint, "FREE": osim.FreeJoint}[kind]
            ends = inner, *_make_frame(place, turned @ A), body, *_make_frame(end, A)
            joint = make(f"{name}_joint", *ends)
            self._model.addJoint(joint)
            coordinates = [joint.upd_coordinates(k) for k in range({"BALL": 3, "FREE": 6, "FIXED": 0}[kind])]
        moves = limb["moves"]
        for k, (slides, axis) in enumerate(moves):
            outer, to = body, end
            if k + 1 < len(moves):
                outer, to = osim.Body(f"{name}_massless", 0.0, osim.Vec3(0), osim.Inertia(0.0)), np.zeros(3)
                self._model.addBody(outer)
            A = _make_axes(np.array(axis), 0 if slides else 2)
            make = osim.SliderJoint if slides else osim.PinJoint
            joint = make(f"{name}_joint_{k}", inner, *_make_frame(place, turned @ A), outer, *_make_frame(to, A))
            self._model.addJoint(joint)
            coordinate, torsion = joint.upd_coordinates(0), limb["torsion"]
            coordinate.setName(f"{name}_coordinate_{k}")
            coordinates.append(coordinate)
            if limb["drive"] is not None:
                coordinate.setPrescribedFunction(_make_motion(**limb["drive"]))
                self._driven.append((coordinate, limb))
            if torsion is not None:
                force = osim.SpringGeneralizedForce(coordinate.getName())
                force.setStiffness(torsion["stiffness"])
                force.setRestLength(torsion["rest_angle"])
                force.setViscosity(torsion["damping"])
                self._model.addForce(force)
            inner, place, turned = outer, np.zeros(3), np.eye(3)
        self._joints.append((limb, coordinates, A))

    def _add_load(self, k: int, load: dict[str, Any]) -> None:
        """Add load ``k`` to the model: a force and a torque as functions of time, at a point of the body."""
        force = osim.PrescribedForce(f"load_{k}", self._bodies[load["body"]])
        for name in ("force", "torque"):
            parts = [_make_function(load["factor"], x) for x in load[name]]
            getattr(force, f"set{name.capitalize()}Functions")(*parts)
        force.setPointFunctions(*(osim.Constant(x) for x in load["point"]))
        force.setForceIsInGlobalFrame(not load["follows"])
        force.setPointIsInGlobalFrame(False)
        self._model.addForce(force)

    def _find_indices(self) -> None:
        """Set ``_q_at`` and ``_u_at``, the indices of each joint's coordinates in Simbody's q and u, and ``_V``.

        They are found by changes of one coordinate at a time; all are zero afterwards. Simbody's velocities are V u at
        the start, with u those of the tree.
        """
        state, nu = self._state, len(self._data["start_velocity"])
        self._q_at, self._u_at = [], []
        for _, coordinates, _ in self._joints:
            here: list[list[int]] = [[], []]
            for coordinate in coordinates:
                before = state.getQ().to_numpy().copy(), state.getU().to_numpy().copy()
                coordinate.setValue(state, coordinate.getValue(state) + 0.125, False)
                coordinate.setSpeedValue(state, coordinate.getSpeedValue(state) + 0.125)
                after = state.getQ().to_numpy(), state.getU().to_numpy()
                for found, a, b in zip(here, before, after, strict=True):
                    found.append(int(np.argmax(np.abs(b - a))))
                coordinate.setValue(state, 0.0, False)
                coordinate.setSpeedValue(state, 0.0)
            self._q_at.append(here[0])
            self._u_at.append(here[1])
        self._V = np.zeros((state.getNU(), nu))
        for (limb, _, A), at in zip(self._joints, self._u_at, strict=True):
            to, kind = limb["u_at"], limb["kind"]
            if kind == "FREE":  # angular velocity, then velocity, both in the frame at the start
                R = np.array(limb["R"])
                self._V[np.ix_(at[:3], range(to + 3, to + 6))] = np.eye(3)
                self._V[np.ix_(at[3:], range(to, to + 3))] = R.T
            elif kind == "BALL":
                self._V[np.ix_(at, range(to, to + 3))] = A.T
            else:
                self._V[at, range(to, to + len(at))] = 1.0

    def _set_start(self, u: np.ndarray) -> None:
        """Set the state to the start, where all coordinates of Simbody are 0, with velocities ``u`` of the tree."""
        state = self._state
        state.setTime(0.0)
        state.setQ(osim.Vector(state.getNQ(), 0.0))
        state.setU(osim.Vector.createFromMat(self._V @ u))

    def _convert_to_tree(self, theirs: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return coordinates q (nt, nq) and velocities u (nt, nu) of the tree from Simbody's, ``theirs`` and ``v``."""
        q = np.zeros((len(theirs), len(self._data["start"])))
        u = np.zeros((len(v), len(self._data["start_velocity"])))
        for (limb, _, A), q_at, u_at in zip(self._joints, self._q_at, self._u_at, strict=True):
            at, to, kind = limb["q_at"], limb["u_at"], limb["kind"]
            if kind in ("BALL", "FREE"):
                turned = _make_quaternions(theirs[:, q_at[:3]])
                spin = np.einsum("tji,tj->ti", make_matrices(turned), v[:, u_at[:3]]) @ A.T
            if kind == "BALL":
                q[:, at], q[:, at + 1 : at + 4] = turned[:, 0], turned[:, 1:] @ A.T
                u[:, to : to + 3] = spin
            elif kind == "FREE":
                R = np.array(limb["R"])
                q[:, at : at + 3] = limb["r"] + theirs[:, q_at[3:]] @ R.T
                q[:, at + 3 : at + 7] = _multiply_quaternions(np.array(self._data["start"][at + 3 : at + 7]), turned)
                u[:, to : to + 3], u[:, to + 3 : to + 6] = v[:, u_at[3:]] @ R.T, spin
            else:
                q[:, at : at + len(q_at)], u[:, to : to + len(u_at)] = theirs[:, q_at], v[:, u_at]
        return q, u


def _make_function(numbers: list[float], factor: float = 1.0) -> Any:
    """Return ``factor`` times the function of time with the parameters ``numbers``, as an expression of OpenSim.

    It is c_0 + c_1 t + c_2 t^2 + c_3 t^3 + a sin(w t + p).
    """
    c_0, c_1, c_2, c_3, a, w, p = numbers
    law = f"({c_0!r}+({c_1!r})*t+({c_2!r})*t^2+({c_3!r})*t^3+({a!r})*sin(({w!r})*t+({p!r})))"
    return osim.ExpressionBasedFunction(f"({factor!r})*{law}", ["t"])


def _make_motion(name: str, motion: list[float]) -> Any:
    """Return the function of time of the drive ``name``: a polynomial, or a constant plus a sine.

    ``motion`` has four coefficients of the polynomial, then amplitude, frequency and phase. Raises ValueError if it has
    both.

    OpenSim's expressions cannot serve here: their second derivative is the first (4.6).
    """
    *c, a, w, p = motion
    if a == 0.0:
        return osim.PolynomialFunction(osim.Vector.createFromMat(np.array(c[::-1])))
    if any(c[1:]):
        raise ValueError(f"the drive {name!r} is a polynomial and a sine: OpenSim cannot differentiate it twice")
    return osim.Sine(a, w, p, c[0])


def _make_frame(place: np.ndarray, turned: np.ndarray) -> tuple[Any, Any]:
    """Return OpenSim's vectors of a frame: its position ``place``, and x-y-z angles [rad] of ``turned``."""
    a, c = np.arctan2(-turned[1, 2], turned[2, 2]), np.arctan2(-turned[0, 1], turned[0, 0])
    if np.hypot(turned[0, 0], turned[0, 1]) < 1e-9:
        a, c = np.arctan2(turned[2, 1], turned[1, 1]), 0.0
    b = np.arctan2(turned[0, 2], np.hypot(turned[0, 0], turned[0, 1]))
    return osim.Vec3(*map(float, place)), osim.Vec3(float(a), float(b), float(c))


def _make_axes(axis: np.ndarray, which: int) -> np.ndarray:
    """Return a rotation matrix with the unit vector ``axis`` as column ``which``; the others are arbitrary."""
    one = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    one /= np.linalg.norm(one)
    columns = [axis, one, np.cross(axis, one)]
    return np.stack([columns[(k - which) % 3] for k in range(3)], axis=1)


def _make_quaternions(angles: np.ndarray) -> np.ndarray:
    """Return the quaternions (w, x, y, z) of R_x R_y R_z, from angles (n, 3) [rad]."""
    half = 0.5 * angles
    parts = [np.zeros((len(angles), 4)) for _ in range(3)]
    for k, part in enumerate(parts):
        part[:, 0], part[:, 1 + k] = np.cos(half[:, k]), np.sin(half[:, k])
    return _multiply_quaternions(_multiply_quaternions(parts[0], parts[1]), parts[2])


def _multiply_quaternions(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the products of quaternions ``a``, one or (n, 4), and ``b`` (n, 4), (w, x, y, z)."""
    (aw, ax, ay, az), (bw, bx, by, bz) = np.broadcast_to(a, b.shape).T, b.T
    vector = aw * np.stack((bx, by, bz)) + bw * np.stack((ax, ay, az)) + np.cross((ax, ay, az), (bx, by, bz), axis=0)
    return np.stack((aw * bw - ax * bx - ay * by - az * bz, *vector), axis=-1)
