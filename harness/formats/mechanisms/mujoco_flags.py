"""Apply the flags of a MuJoCo model that change which forces act or which rows hold to the numbers of the model.

Every flag of MuJoCo is in one of the lists; a set flag that is in none, as of a later version, is refused by name.
"""

from typing import Any

SPRINGS = ("jnt_stiffness", "jnt_stiffnesspoly", "tendon_stiffness", "tendon_stiffnesspoly")
DAMPERS = ("dof_damping", "dof_dampingpoly", "tendon_damping", "tendon_dampingpoly")
OFF = {  # numbers that are zero where the flag is disabled
    "SPRING": SPRINGS,
    "DAMPER": DAMPERS,
    "PASSIVE": (*SPRINGS, *DAMPERS),  # PASSIVE: MuJoCo before 3.3.7
    "EQUALITY": ("eq_active0",),
    "CONSTRAINT": (
        "eq_active0",
        "dof_frictionloss",
        "tendon_frictionloss",
        "jnt_limited",
        "tendon_limited",
        "geom_contype",
        "geom_conaffinity",
    ),
    "FRICTIONLOSS": ("dof_frictionloss", "tendon_frictionloss"),
    "LIMIT": ("jnt_limited", "tendon_limited"),
    "CONTACT": ("geom_contype", "geom_conaffinity"),
}
READ = ("GRAVITY",)  # read where the system is created
WITHOUT_EFFECT = (  # on the forces that act here: collisions, actuators and how MuJoCo computes
    "CLAMPCTRL",
    "WARMSTART",
    "FILTERPARENT",
    "ACTUATION",
    "REFSAFE",
    "SENSOR",
    "MIDPHASE",
    "EULERDAMP",
    "AUTORESET",
    "NATIVECCD",
    "ISLAND",
    "MULTICCD",
)
ENABLED = (  # flags to be enabled that change no force here
    "OVERRIDE",
    "ENERGY",
    "FWDINV",
    "INVDISCRETE",
    "SLEEP",
    "DIAGEXACT",
    "IPC",
    "SPECULATIVE",
    "MULTICCD",
    "ISLAND",
)


def apply_flags(mj: Any, m: Any) -> None:
    """Set to 0 the numbers of model ``m`` that its disable flags switch off, in place.

    Raise ValueError for a flag in none of the lists.
    """
    for name in _list_flags(mj.mjtDisableBit, "mjDSBL_", m.opt.disableflags):
        if name not in (*OFF, *READ, *WITHOUT_EFFECT):
            raise ValueError(f"flag {name.lower()} is disabled, which is not supported")
        for array in OFF.get(name, ()):
            if hasattr(m, array):
                getattr(m, array)[:] = 0
    for name in _list_flags(mj.mjtEnableBit, "mjENBL_", m.opt.enableflags):
        if name not in ENABLED:
            raise ValueError(f"flag {name.lower()} is enabled, which is not supported")


def _list_flags(bits: Any, prefix: str, mask: int) -> list[str]:
    """Return the names, without ``prefix``, of the flags of the enumeration ``bits`` that are set in ``mask``."""
    return [
        name.removeprefix(prefix)
        for name, bit in bits.__members__.items()
        if name.startswith(prefix) and int(mask) & int(bit)
    ]
