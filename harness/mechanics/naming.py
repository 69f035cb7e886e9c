"""Name bodies, joints and forces in messages: by the user's name in quotes, else by number, counted from 0."""

import re
from typing import Protocol, runtime_checkable

# names that ``assemble`` gives: they keep the number of the list it was given, also where parts are renumbered
DEFAULT = re.compile(r"(body|joint) \d+(, row \d+)?")


@runtime_checkable
class NamedSystem(Protocol):
    """A system as far as its names go; a system may have none."""

    @property
    def body_names(self) -> tuple[str, ...]: ...

    @property
    def joint_names(self) -> tuple[str, ...]: ...


def name_part(kind: str, number: int, name: str | None = "") -> str:
    """Return what messages call a part: ``body 'left leg'``, or ``body 0`` where it has no name of its own."""
    if not name:
        return f"{kind} {number}"
    return name if DEFAULT.fullmatch(name) else f"{kind} {name!r}"


def name_body(system: NamedSystem, body: int) -> str:
    """Return what messages call a body of ``system``, by name or number; -1 is the ground."""
    if body < 0:
        return "the ground"
    return name_part("body", body, system.body_names[body] if system.body_names else "")


def name_joint(system: NamedSystem, joint: int) -> str:
    """Return what messages call a joint of ``system``, by name or number."""
    return name_part("joint", joint, system.joint_names[joint] if system.joint_names else "")
