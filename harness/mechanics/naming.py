"""Name bodies, joints and forces in messages: by the user's name in quotes, else by number, counted from 0."""

import re
from typing import Protocol, runtime_checkable

# names that ``assemble`` gives: they keep the number of the list it was given, also where parts are renumbered
DEFAULT = re.compile(r"(body|joint) \d+(, row \d+)?")


@runtime_checkable
class NamedSystem(Protocol):
    """The names of a system's bodies and joints; both tuples may be empty."""

    @property
    def body_names(self) -> tuple[str, ...]: ...

    @property
    def joint_names(self) -> tuple[str, ...]: ...


def name_part(kind: str, number: int, name: str | None = "") -> str:
    """Return the name of a part in messages: ``body 'left leg'``, or ``body 0`` where it has no name of its own."""
    if not name:
        return f"{kind} {number}"
    return name if DEFAULT.fullmatch(name) else f"{kind} {name!r}"


def name_body(system: NamedSystem, body: int) -> str:
    """Return the name of a body of ``system`` in messages, by its name or number; -1 is the ground."""
    if body < 0:
        return "the ground"
    return name_part("body", body, system.body_names[body] if system.body_names else "")


def name_joint(system: NamedSystem, joint: int) -> str:
    """Return the name of a joint of ``system`` in messages, by its name or number."""
    return name_part("joint", joint, system.joint_names[joint] if system.joint_names else "")
