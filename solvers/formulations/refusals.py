"""Why a method cannot take some kinds of joints or forces."""

from ...harness.mechanics.joints import KINDS, NAMED
from ...harness.mechanics.system import MultibodySystem

VELOCITIES_ALONE = (
    "holds constraints by their phi, and a knife edge or a rolling disc has none: use a method that holds A v = b, "
    "such as gc_weak_form, rkmk_dop853, half_explicit or ida_index1"
)
GRADIENTS = (
    "has discrete gradients of joints and springs between points only, not of drives, knife edges, discs, torsional "
    "springs and user forces: use gc_weak_form or rkmk_dop853"
)


def unknown_to_kernels(system: MultibodySystem) -> str | None:
    """The refusal of a method on kernels written by hand, which take a kind that they do not know for another."""
    found = next((KINDS[k] for k in system.joint_sort if KINDS[k] not in NAMED), None)
    return None if found is None else f"its kernels do not know {found}: use rkmk_dop853, rattle or ida_index1"


def without_phi(system: MultibodySystem) -> str | None:
    """The refusal of a method that needs phi in every row."""
    return None if system.is_holonomic else VELOCITIES_ALONE


def without_gradient(system: MultibodySystem) -> str | None:
    """The refusal of a method of discrete gradients."""
    beyond = len(system.moving_rows().joint) or len(system.torsion_k) or len(system.user_i)
    return GRADIENTS if beyond else None
