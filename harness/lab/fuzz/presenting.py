"""Present a problem in another form: split a body into two welded ones, turn all, then ``mechanics.presentation``.

``split`` takes half of the largest second moment out of a body, along its axis. This determines the distance of the
centres of the two parts, and leaves both physically possible. The first keeps the number, the second is the last body;
every second joint and spring of the body goes with it. The weld is a fixed joint or, for codes that have none, a hinge
and a ball beside its axis, with two redundant rows.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from ...catalogue.registry import rotate_problem
from ...mechanics import so3
from ...mechanics.joints import Joint, JointKind
from ...mechanics.presentation import Presentation
from ...mechanics.state import State, States, rotate_states
from ...mechanics.system import MultibodySystem, RigidBody, assemble
from ...mechanics.types import Problem, Solver, StepControl, Trajectory
from ...run.presenting import PresentedSolver, present_problem

Weld = Literal["fixed", "pinned"]
FRACTION = 0.4  # fraction of the mass in the first part
TAKEN = 0.5  # fraction of the largest second moment that the distance of the parts replaces
ALIKE = 1e-6  # relative second moment below which a body has no extent: its parts share one centre


@dataclass(frozen=True)
class Form:
    """Describe how a problem is presented; the defaults leave it unchanged."""

    split: int = 0  # body that is split, counted from 1; 0: none
    weld: Weld = "fixed"
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rotation vector of everything
    plain: Presentation = field(default_factory=Presentation)

    @staticmethod
    def parse(words: Mapping[str, str]) -> "Form":
        """Return the form with the changes ``words`` by name, such as {"split": "2"}, as ``str(form)`` writes them.

        Raise ValueError if they are invalid.
        """
        defaults, given = vars(Presentation()), dict(words)
        try:
            split = int(given.pop("split", "0"))
            turned = tuple(map(float, given.pop("rotation", "0,0,0").split(",")))
            if len(turned) != 3:
                raise ValueError(f"rotation takes three numbers (got {len(turned)})")
            values = {name: type(defaults[name])(text) for name, text in given.items()}
            return Form(split, "fixed", turned, Presentation(**values))
        except KeyError as error:
            known = ", ".join(["split", "rotation", *defaults])
            raise ValueError(f"a form has no {error.args[0]!r} (it has {known})") from None

    def problem(self, problem: Problem) -> Problem:
        """Return ``problem`` with its body split and all rotated; the rest of the form becomes its presentation.

        That is applied when it is solved (``present_problem``). Reference, observables and invariants are dropped.
        """
        bare = replace(problem, reference_from=None, observables=(), invariants=(), presentation=Presentation())
        if self.split:
            parts = _SplitBody(problem.system, self.split - 1)
            bare = replace(bare, system=parts.split_system(self.weld), initial=parts.split_state(problem.initial))
        return replace(rotate_problem(bare, so3.exp(np.array(self.rotation))), presentation=self.plain)

    def present_problem(self, problem: Problem) -> Problem:
        """Return ``problem`` in this form as a solver receives it, with the presentation applied."""
        return present_problem(self.problem(problem), StepControl(dt=problem.dt))[0]

    def refuses(self, solver: Solver, problem: Problem, control: StepControl) -> str | None:
        """Return why ``solver`` cannot take this form of ``problem``; None if it can."""
        return PresentedSolver(solver).refuses(self.problem(problem), control)

    def solve(self, solver: Solver, problem: Problem, control: StepControl) -> Trajectory:
        """Solve ``problem`` in this form; return the motion, transformed back to its own bodies, without reactions."""
        found = PresentedSolver(solver).solve(self.problem(problem), control)
        home = rotate_states(found.states, so3.exp(-np.array(self.rotation)))
        if self.split:
            home = _SplitBody(problem.system, self.split - 1).merge_states(home)
        return replace(found, states=home, reaction=None)

    def list_smaller_forms(self) -> tuple["Form", ...]:
        """Return the forms in which one of the changes of this form is undone."""
        out = []
        if self.split:
            out.append(replace(self, split=0))
        if any(self.rotation):
            out.append(replace(self, rotation=(0.0, 0.0, 0.0)))
        for name, default in vars(Presentation()).items():
            if getattr(self.plain, name) != default:
                out.append(replace(self, plain=replace(self.plain, **{name: default})))
        return tuple(out)

    def __str__(self) -> str:
        """Return the form in words, as those of ``--problem-set``; ``as drawn`` if nothing is changed."""
        words = [f"split={self.split}", f"weld={self.weld}"] if self.split else []
        if any(self.rotation):
            words.append("rotation=" + ",".join(f"{x:.17g}" for x in self.rotation))
        for name, default in vars(Presentation()).items():
            if (value := getattr(self.plain, name)) != default:
                words.append(f"{name}={value}")
        return " ".join(words) or "as drawn"


@dataclass(frozen=True)
class _SplitBody:
    """The system ``whole`` with body number ``body`` split into two parts."""

    whole: MultibodySystem
    body: int

    @property
    def separation(self) -> Float[np.ndarray, " 3"]:
        """Vector from the C of the second part to that of the first [m], in the frame of the body."""
        mass, J = self.whole.mass[self.body], self.whole.inertia[self.body]
        moments, axes = np.linalg.eigh(0.5 * np.trace(J) * np.eye(3) - J)
        largest = moments[2] if moments[2] > ALIKE * np.trace(J) else 0.0
        out: np.ndarray = np.sqrt(TAKEN * largest / (FRACTION * (1.0 - FRACTION) * mass)) * axes[:, 2]
        return out

    @property
    def offsets(self) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
        """Vectors from the C of the body to those of the two parts [m], in the frame of the body."""
        return (1.0 - FRACTION) * self.separation, -FRACTION * self.separation

    def split_system(self, weld: Weld) -> MultibodySystem:
        """Return the system with the body split; the weld of the parts is the last joint (two, if it is pinned).

        The second part is the last body. Raise ValueError for systems with loads or user forces.
        """
        s, b, d = self.whole, self.body, self.separation
        if len(s.user_i) or len(s.load_i):
            raise ValueError("split takes no system with loads or user forces")
        left = s.inertia[b] - FRACTION * (1.0 - FRACTION) * s.mass[b] * (d @ d * np.eye(3) - np.outer(d, d))
        parts = [RigidBody(share * s.mass[b], share * left) for share in (FRACTION, 1.0 - FRACTION)]
        welded = assemble(parts, self._make_weld(weld))
        changes: dict[str, Any] = {
            "mass": np.append(s.mass, parts[1].mass),
            "inertia": np.concatenate((s.inertia, parts[1].inertia[None])),
        }
        changes["mass"][b], changes["inertia"][b] = parts[0].mass, parts[0].inertia
        for of, arm in (("joint", "joint_s"), ("spring", "spring_p")):
            ends = {e: np.array(getattr(s, f"{of}_{e}")) for e in "ij"}
            arms = {e: np.array(getattr(s, f"{arm}_{e}")) for e in "ij"}
            own = [(k, e) for k in range(len(ends["i"])) for e in "ij" if ends[e][k] == b]
            for n, (k, e) in enumerate(own, 1):  # ends go alternately to the second and the first part
                arms[e][k] -= self.offsets[n % 2]
                ends[e][k] = (b, s.nb)[n % 2]
            changes |= {f"{of}_{e}": ends[e] for e in "ij"} | {f"{arm}_{e}": arms[e] for e in "ij"}
        number = np.array([b, s.nb])
        for name, more in vars(welded).items():
            if name.startswith("joint_") and isinstance(more, np.ndarray):
                more = number[more] if name in ("joint_i", "joint_j") else more
                changes[name] = np.concatenate((changes.get(name, getattr(s, name)), more))
        for a in changes.values():
            a.setflags(write=False)
        names = (*s.body_names, "second part")
        return replace(s, **changes, body_names=names, joint_names=(*s.joint_names, *welded.joint_names))

    def split_state(self, state: State) -> State:
        """Return the state of the split system: poses and velocities of the parts, the second part as the last body."""
        both = [self._move_point(States.one(state), offset) for offset in self.offsets]
        r, v = (np.concatenate((getattr(state, n), getattr(both[1], n)[0])) for n in ("r", "v"))
        r[self.body], v[self.body] = both[0].r[0, 0], both[0].v[0, 0]
        R, Omega = (np.concatenate((a, a[self.body : self.body + 1])) for a in (state.R, state.Omega))
        return State(r, R, v, Omega, state.t)

    def merge_states(self, s: States) -> States:
        """Return the states of the unsplit system from those of the split one: the body follows from its first part."""
        at = self._move_point(s, -self.offsets[0])
        r, v = s.r[:, :-1].copy(), s.v[:, :-1].copy()
        r[:, self.body], v[:, self.body] = at.r[:, 0], at.v[:, 0]
        return States(r, s.R[:, :-1], v, s.Omega[:, :-1], s.t)

    def _move_point(self, s: States, offset: Float[np.ndarray, " 3"]) -> States:
        """Return the states of a point of the body, ``offset`` [m] from its C in its frame, as of a separate body."""
        b = slice(self.body, self.body + 1)
        r = s.r[:, b] + s.R[:, b] @ offset
        v = s.v[:, b] + np.einsum("tbij,tbj->tbi", s.R[:, b], np.cross(s.Omega[:, b], offset))
        return States(r, s.R[:, b], v, s.Omega[:, b], s.t)

    def _make_weld(self, weld: Weld) -> list[Joint]:
        """Return the joints that weld part 0 and part 1 at the C of the whole body.

        They are a fixed joint or, if pinned, a hinge along z and a ball beside it.
        """
        x, _, z = np.eye(3)
        at = [-offset for offset in self.offsets]
        if weld == "fixed":
            return [Joint(1, at[1], 0, at[0], z, z, "weld", JointKind.FIXED, x, x)]
        arm = max(float(np.linalg.norm(self.separation)), float(self.whole.gyration[self.body]))
        return [Joint(1, at[1], 0, at[0], z, z, "weld"), Joint(1, at[1] + arm * x, 0, at[0] + arm * x, name="weld 2")]
