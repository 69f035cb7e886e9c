"""Declare the kinds of applied forces, one file each: the user's input, and force and torque as equations."""

from ..declaring import ForceDeclaration
from . import load, spring, torsion
from .load import Load
from .spring import SpringDamper
from .torsion import TorsionSpring

__all__ = ["DECLARED", "Load", "SpringDamper", "TorsionSpring"]

DECLARED: dict[str, ForceDeclaration] = {one.KIND.name: one.KIND for one in (spring, torsion, load)}
