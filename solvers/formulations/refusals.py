"""Refusals of methods that cannot take some kinds of joints or forces."""

from ...harness.mechanics.system import MultibodySystem

VELOCITIES_ALONE = (
    "holds constraints by their phi, and a knife edge or a rolling disc has none: use a method that holds A v = b, "
    "such as gc_weak_form, rkmk_dop853, half_explicit or ida_index1"
)
GRADIENTS = (
    "has discrete gradients of joints and springs between points only, not of drives, knife edges, discs, torsional "
    "springs and user forces: use gc_weak_form or rkmk_dop853"
)


def refuse_without_phi(system: MultibodySystem) -> str | None:
    """Return the refusal of a method that needs phi in every constraint row, or None if the system has it."""
    return None if system.is_holonomic else VELOCITIES_ALONE


def refuse_without_gradient(system: MultibodySystem) -> str | None:
    """Return the refusal of a method that needs discrete gradients of all joints and forces, or None if they exist."""
    unsupported = len(system.moving_rows().joint) or len(system.torsion_k) or len(system.user_i)
    return GRADIENTS if unsupported else None
