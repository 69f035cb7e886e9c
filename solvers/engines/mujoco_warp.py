"""MuJoCo Warp: MuJoCo's model in single precision on a CPU, stepped by a loop in Python.

The tree and the soft constraints are those of ``mujoco``. The model check compares the forces of its unconstrained
accelerations, and its rows of loops, to the rounding of single precision (``export.model_check``). On a CPU a step
launches about a hundred kernels: its times say nothing about its intended hardware.
"""

from dataclasses import dataclass
from typing import ClassVar

from ...harness.catalogue.options import option
from ...harness.catalogue.registry import solver
from .export.engine import SupportedElements
from .export.model_check import SINGLE
from .export.protocol import Adapter
from .mujoco import LACKS

INTEGRATORS = {"RK4": 4.0, "Euler": 1.0, "implicitfast": 1.0}


@solver("mujoco_warp")
@dataclass(frozen=True)
class MuJoCoWarp(Adapter):
    """MuJoCo Warp's integrators on a CPU."""

    integrator: str = option("RK4", "MuJoCo's name of it", choices=tuple(INTEGRATORS))
    time_constant: float = option(2.0, "time constant of the soft constraints, in steps", at_least=2.0)
    impedance: float = option(0.99, "impedance of the soft constraints", at_least=1e-4, at_most=0.9999)
    settings: str = option("ours", "ours: the options above; default: the engine's own", choices=("ours", "default"))

    inside: ClassVar[str] = "mujoco_warp"
    package: ClassVar[str] = "mujoco_warp"
    wheel: ClassVar[str] = "mujoco-warp"
    takes: ClassVar[SupportedElements] = SupportedElements(loads="constant", lacks=LACKS)
    eps: ClassVar[float] = SINGLE
    checks_random_velocities: ClassVar[bool] = True
    stretch: ClassVar[int] = 200

    @property
    def order(self) -> float:
        """Order of the integrator, observed where the rounding of single precision is negligible."""
        return INTEGRATORS[self.integrator if self.settings == "ours" else "Euler"]
