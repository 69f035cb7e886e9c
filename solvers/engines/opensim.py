"""OpenSim: Simbody's joint coordinates and integrators with error control, in an environment of its own.

Accuracy is rtol: Simbody estimates the error of each coordinate, weighted, and projects every step onto the loops,
which are point constraints. Drives prescribe coordinates. With ``settings`` "default" accuracy is that of a
Manager that nobody configured.
"""

from dataclasses import dataclass
from typing import ClassVar

from ...harness.catalogue.options import option
from ...harness.catalogue.registry import solver
from .export.protocol import Adapter
from .export.tree import DRIVES, KINDS

INTEGRATORS = ("RungeKuttaMerson", "RungeKuttaFeldberg", "RungeKutta3", "RungeKutta2", "Verlet", "SemiExplicitEuler2",
               "CPodes")  # fmt: skip


@solver("opensim")
@dataclass(frozen=True)
class OpenSim(Adapter):
    """Simbody's integrators with error control."""

    integrator: str = option("RungeKuttaMerson", "OpenSim's name of it; this is its default", choices=INTEGRATORS)
    settings: str = option("ours", "accuracy as given by rtol, or as it comes", choices=("ours", "default"))

    control: ClassVar[str] = "rtol"
    kinds: ClassVar[tuple[str, ...]] = (*KINDS, *DRIVES)
    loads: ClassVar[str] = "varying"
    inside: ClassVar[str] = "opensim"
    package: ClassVar[str] = "opensim"
    wheel: ClassVar[str] = "opensim"
    remedy: ClassVar[str] = "make engines"
