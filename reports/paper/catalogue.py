"""The paper's twelve figures, each as printed and, where it compares solvers, with their recommended settings."""

from . import chain, grid, pendulum, top, torque_free
from .spec import PaperFigure

FIGURES: tuple[PaperFigure, ...] = (
    *torque_free.FIGURES, *pendulum.FIGURES, *chain.FIGURES, *top.FIGURES, *grid.FIGURES,
)  # fmt: skip
NUMBERS = range(1, 13)
