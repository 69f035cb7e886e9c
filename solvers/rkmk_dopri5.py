"""Runge-Kutta-Munthe-Kaas with the pair 5(4) of Dormand and Prince (1980), on index 1, projected.

Unknowns are positions and rotation vectors of the step, R = R0 exp(theta), with theta' = dexp^-1(theta) Omega
(Munthe-Kaas 1999, Appl. Numer. Math. 29), and velocities; accelerations follow from S lam = -gamma - A M^-1 f,
S = A M^-1 A^T (Eq. 92, M^-1 substituted). After every accepted step poses are projected onto phi = 0 and velocities
onto A v = 0 along M^-1 A^T. Redundant rows get a multiplier of zero; nothing else
stabilises or damps the motion.
"""

from dataclasses import dataclass
from typing import ClassVar

from ..harness.base.tableaux import DOPRI5, Tableau
from ..harness.catalogue.registry import solver
from .formulations.methods.rkmk import ExplicitPair


@solver("rkmk_dopri5")
@dataclass(frozen=True)
class RkmkDopri5(ExplicitPair):
    """Dormand-Prince 5(4) on the rotation group, index 1 with projection, error control."""

    tableau: ClassVar[Tableau] = DOPRI5
    pair: ClassVar[str] = "5(4)"
