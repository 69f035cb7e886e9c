"""Flags of a model of MuJoCo: those that change which forces act or which rows hold are applied to its numbers.

Every flag of MuJoCo's is in one of the lists; a flag of a later version that is set and in none is refused by name.
"""

from typing import Any

SPRINGS = ("jnt_stiffness", "jnt_stiffnesspoly", "tendon_stiffness", "tendon_stiffnesspoly")
DAMPERS = ("dof_damping", "dof_dampingpoly", "tendon_damping", "tendon_dampingpoly")
OFF = {  # numbers that are zero where the flag is disabled
    "SPRING": SPRINGS, "DAMPER": DAMPERS, "PASSIVE": (*SPRINGS, *DAMPERS),  # the last of MuJoCo before 3.3.7
    "EQUALITY": ("eq_active0",),
    "CONSTRAINT": ("eq_active0", "dof_frictionloss", "tendon_frictionloss", "jnt_limited", "tendon_limited",
                   "geom_contype", "geom_conaffinity"),
    "FRICTIONLOSS": ("dof_frictionloss", "tendon_frictionloss"), "LIMIT": ("jnt_limited", "tendon_limited"),
    "CONTACT": ("geom_contype", "geom_conaffinity"),
}  # fmt: skip
READ = ("GRAVITY",)  # where the system is made
WITHOUT_EFFECT = (  # on which forces act here: collisions, actuators and how MuJoCo computes
    "CLAMPCTRL", "WARMSTART", "FILTERPARENT", "ACTUATION", "REFSAFE", "SENSOR", "MIDPHASE", "EULERDAMP", "AUTORESET",
    "NATIVECCD", "ISLAND", "MULTICCD",
)  # fmt: skip
ENABLED = ("OVERRIDE", "ENERGY", "FWDINV", "INVDISCRETE", "SLEEP", "DIAGEXACT", "IPC", "SPECULATIVE", "MULTICCD",
           "ISLAND")  # fmt: skip


def apply_flags(mj: Any, m: Any) -> None:
    """Set to zero what flags disable; ValueError of a flag that is not known."""
    for name in _flags(mj.mjtDisableBit, "mjDSBL_", m.opt.disableflags):
        if name not in (*OFF, *READ, *WITHOUT_EFFECT):
            raise ValueError(f"flag {name.lower()} is disabled, which is not taken over")
        for array in OFF.get(name, ()):
            if hasattr(m, array):
                getattr(m, array)[:] = 0
    for name in _flags(mj.mjtEnableBit, "mjENBL_", m.opt.enableflags):
        if name not in ENABLED:
            raise ValueError(f"flag {name.lower()} is enabled, which is not taken over")


def _flags(bits: Any, prefix: str, given: int) -> list[str]:
    return [name.removeprefix(prefix) for name, bit in bits.__members__.items()
            if name.startswith(prefix) and int(given) & int(bit)]  # fmt: skip
