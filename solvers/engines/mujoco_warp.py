"""MuJoCo Warp on a CPU: MuJoCo's model in single precision, stepped by a loop in Python.

The tree and the soft constraints are those of ``mujoco``. Its accelerations without constraints are compared with ours
at the start and at rest; 2.4e-3 is allowed as in ``export.stepped``.
On a CPU a step takes a hundred launches of kernels: its speed is not meant.
"""

from dataclasses import dataclass
from typing import ClassVar

from ...harness.catalogue.options import option
from ...harness.catalogue.registry import solver
from ...harness.mechanics.joints import JointKind
from .export.protocol import Adapter
from .export.stepped import ALLOWED, SINGLE

INTEGRATORS = {"RK4": 4.0, "Euler": 1.0, "implicitfast": 1.0}


@solver("mujoco_warp")
@dataclass(frozen=True)
class MuJoCoWarp(Adapter):
    """MuJoCo Warp on a CPU."""

    integrator: str = option("RK4", "MuJoCo's name of it", choices=tuple(INTEGRATORS))
    time_constant: float = option(2.0, "time constant of the soft constraints, in steps", at_least=2.0)
    impedance: float = option(0.99, "impedance of the soft constraints", at_least=1e-4, at_most=0.9999)
    settings: str = option("ours", "as above, or as MuJoCo ships them", choices=("ours", "default"))

    inside: ClassVar[str] = "mujoco_warp"
    package: ClassVar[str] = "mujoco_warp"
    wheel: ClassVar[str] = "mujoco-warp"
    kinds: ClassVar[tuple[str, ...]] = (JointKind.SPHERICAL, JointKind.REVOLUTE)
    springs: ClassVar[bool] = False
    torsions: ClassVar[bool] = False
    same: ClassVar[float] = ALLOWED * SINGLE ** (2.0 / 3.0)
    stretch: ClassVar[int] = 200

    @property
    def order(self) -> float:
        """Order of its steps, as long as single precision does not show."""
        return INTEGRATORS[self.integrator if self.settings == "ours" else "Euler"]
