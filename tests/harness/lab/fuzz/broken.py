"""Solvers with one fault each, around a sound one."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from mbsbench import MultibodySystem, Problem, StepControl, Trajectory
from mbsbench.harness.catalogue.registry import make_solver

SOUND = "rkmk_dopri5"


@dataclass(frozen=True)
class Broken:
    """Solves the system that ``mistake`` makes of the one it gets."""

    name: ClassVar[str] = "broken"
    control: ClassVar[str] = "rtol"
    paper_label: ClassVar[str] = ""

    def mistake(self, system: MultibodySystem) -> MultibodySystem:
        raise NotImplementedError

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        return None

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        found = make_solver(SOUND).solve(replace(problem, system=self.mistake(problem.system)), control)
        return replace(found, reaction=None)  # its rows are not those of the problem


class NoProducts(Broken):
    """Ignores products of inertia."""

    def mistake(self, system: MultibodySystem) -> MultibodySystem:
        return replace(system, inertia=system.inertia * np.eye(3))


class YIsUp(Broken):
    """Lets gravity act along -Y, whatever its direction."""

    def mistake(self, system: MultibodySystem) -> MultibodySystem:
        return replace(system, gravity=np.array([0.0, -np.linalg.norm(system.gravity), 0.0]))


class Falls(Broken):
    """Lets gravity act where there is none."""

    def mistake(self, system: MultibodySystem) -> MultibodySystem:
        return replace(system, gravity=np.array([0.0, 0.0, -9.81]))


class OneLoop(Broken):
    """Ignores joints that close a second loop."""

    def mistake(self, system: MultibodySystem) -> MultibodySystem:
        group, closed, keep = list(range(system.nb + 1)), 0, []
        for k, (i, j) in enumerate(zip(system.joint_i.tolist(), system.joint_j.tolist(), strict=True)):
            a, b = group[i], group[j]
            closed += a == b
            if a != b or closed < 2:
                keep.append(k)
            group = [a if g == b else g for g in group]
        names = tuple(system.joint_names[k] for k in keep)
        joints = {n: a[keep] for n, a in vars(system).items() if n.startswith("joint_") and isinstance(a, np.ndarray)}
        return replace(system, **joints, joint_names=names)
