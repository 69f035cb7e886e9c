"""Sizes of a problem that drifts and errors are compared with, known before any solver runs: none can move them."""

import math
from dataclasses import dataclass

import numpy as np

from ..mechanics.motion import kinetic_energy, potential_energy
from ..mechanics.state import State, States
from ..mechanics.system import GROUND, MultibodySystem


@dataclass(frozen=True)
class Scales:
    """Characteristic mass, length and energy of a system at its start."""

    mass: float  # [kg]
    length: float  # [m]
    energy: float  # [J]

    @property
    def speed(self) -> float:
        """sqrt(2 E / m) [m/s]."""
        return math.sqrt(2.0 * self.energy / self.mass)

    def of_unit(self, unit: str) -> float:
        """The scale of a quantity of this SI unit; NaN for a unit not known here."""
        momentum = self.mass * self.speed
        known = {
            "J": self.energy, "m": self.length, "m/s": self.speed, "rad/s": self.speed / self.length,
            "kg m/s": momentum, "kg m2/s": momentum * self.length, "N m s": momentum * self.length,
        }  # fmt: skip
        return known.get(unit, math.nan)


def scales(system: MultibodySystem, start: State) -> Scales:
    """Length: the largest of joint arms, spread of the C's and radius of gyration; energy: T(0) + m g L + springs."""
    gyration = math.sqrt(float(np.max(np.einsum("bii->b", system.inertia) / (2.0 * system.mass))))
    spread = float(np.linalg.norm(np.ptp(start.r, axis=0)))
    arms = np.concatenate((system.joint_s_i, system.joint_s_j[system.joint_j != GROUND]))  # of the ground: a place
    arm = float(np.max(np.linalg.norm(arms, axis=1), initial=0.0))
    length = max(gyration, spread, arm)
    mass = float(np.sum(system.mass))
    one = States.one(start)
    gravity = float(np.linalg.norm(system.gravity))
    springs = float(potential_energy(system, one)[0] + np.einsum("b,i,bi->", system.mass, system.gravity, start.r))
    energy = float(kinetic_energy(system, one)[0]) + mass * gravity * length + springs
    smallest = mass * (1e-6 * length) ** 2  # [J] at rest, free of forces: a micrometre a second, relative to the size
    return Scales(mass, length, max(energy, smallest))
