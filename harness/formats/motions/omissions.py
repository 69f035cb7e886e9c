"""Refuse to judge a motion wrong where omitted parts of its mechanism's file could be the reason."""

import re
from pathlib import Path

from ...base.files import FileError
from ...catalogue import registry
from ...mechanics.types import Law, Problem, Status
from ...results.records import RunRecord
from ...results.words import list_reasons

ACTS = re.compile(
    r"actuator|collid|collision|contact|limit|spring|damp|friction|armature|gravity|fluid|tendon|plugin|wind|decay"
    r"|gripper|transmission|drive|asleep"
)
# laws that a missing force can break
BY_FORCES = {Law.ENERGY, Law.INVARIANT, Law.TRUNCATION, Law.REACTION, Law.MOMENT, Law.MOTION, Law.VELOCITY, Law.ROWS}
REMEDY = "judge a motion without them, or write a servo as stiffness and damping of its joint"


def check_omissions(problem: Problem, path: Path, record: RunRecord) -> None:
    """Raise FileError for a motion judged wrong or inaccurate if omitted parts of the mechanism's file may explain it.

    Errors that no force can cause stay wrong: open joints, rates that contradict the poses, matrices that are no
    rotations. Problems that are not read from a file have no omitted parts.
    """
    make = getattr(registry.problems().get(problem.name), "make", None)
    mechanism = getattr(make, "__self__", None)  # ``make`` is a method of the mechanism read from a file
    omitted = getattr(mechanism, "omitted", {})
    acting = ", ".join(f"{what} ({n})" for what, n in omitted.items() if ACTS.search(what))
    laws = {reason.law for reason in record.reasons}
    if acting and record.status in (Status.WRONG, Status.INACCURATE) and laws <= BY_FORCES:
        reason = next(iter(list_reasons(record)), record.status)
        words = f"but parts of the file of {problem.name} are omitted: {acting}, which may be why; {REMEDY}"
        raise FileError(f"{path}: not judged: {reason}; {words}")
