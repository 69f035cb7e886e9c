"""OpenSim: Simbody's joint coordinates and integrators with error control, in a separate environment.

Accuracy is rtol: Simbody estimates the weighted error of each coordinate. Loops are point constraints; distances and
points on lines are constraints, too; a step is projected onto them where they are violated by more than
``constraint_tolerance``. Drives prescribe coordinates. With ``settings`` "default" the accuracy is that of an
unconfigured Manager.
"""

from dataclasses import dataclass
from typing import ClassVar

from ...harness.catalogue.options import option
from ...harness.catalogue.registry import solver
from ...harness.mechanics.cut_trees.tree import DRIVES, KINDS, LINKS
from ...harness.mechanics.joints import MovingKind
from .export.engine import SupportedElements
from .export.protocol import Adapter

INTEGRATORS = (
    "RungeKuttaMerson",
    "RungeKuttaFeldberg",
    "RungeKutta3",
    "RungeKutta2",
    "Verlet",
    "SemiExplicitEuler2",
    "CPodes",
)


@solver("opensim")
@dataclass(frozen=True)
class OpenSim(Adapter):
    """Simbody's integrators with error control."""

    integrator: str = option("RungeKuttaMerson", "OpenSim's name of it; this is its default", choices=INTEGRATORS)
    constraint_tolerance: float = option(
        0.0, "error of loops beyond which a step is projected; 0: Simbody's, from the accuracy", at_least=0.0
    )
    settings: str = option("ours", "ours: accuracy is rtol; default: the engine's own", choices=("ours", "default"))

    control: ClassVar[str] = "rtol"
    takes: ClassVar[SupportedElements] = SupportedElements(
        (*KINDS, *DRIVES, *LINKS),
        loads="varying",
        lacks={
            MovingKind.ROLLING: "its contact can lift off",
            "rack and pinion": "it couples coordinates of its tree alone",
        },
    )
    inside: ClassVar[str] = "opensim"
    package: ClassVar[str] = "opensim"
    wheel: ClassVar[str] = "opensim"
    remedy: ClassVar[str] = "make engines"
