"""What of a mechanism's file is not taken over and may act: a motion is not wrong because of it."""

import re
from pathlib import Path

from ..catalogue import registry
from ..files import FileError
from ..results.records import RunRecord, reasons_of
from ..results.words import why
from ..types import Law, Problem, Status

ACTS = re.compile(
    r"actuator|collid|collision|contact|limit|spring|damp|friction|armature|gravity|fluid|tendon|plugin|wind|decay"
    r"|gripper|transmission|drive"
)
BY_FORCES = {Law.ENERGY, Law.INVARIANT, Law.TRUNCATION, Law.REACTION, Law.MOTION, Law.VELOCITY, Law.ROWS}
REMEDY = "judge a motion without them, or write a servo as stiffness and damping of its joint"


def check_left_out(problem: Problem, path: Path, record: RunRecord) -> None:
    """Raise FileError for a motion that is not the mechanism's where parts of its file that may act are left out.

    What no force can cause stays wrong: open joints, rates that are not those of the poses, matrices that do not turn.
    """
    made = getattr(registry.problems().get(problem.name), "make", None)
    omitted = getattr(getattr(made, "__self__", None), "omitted", {})
    acting = ", ".join(f"{what} ({n})" for what, n in omitted.items() if ACTS.search(what))
    laws = {reason.law for reason in reasons_of(record.wrong_because)}
    if acting and record.status in (Status.WRONG, Status.INACCURATE) and laws <= BY_FORCES:
        reason = next(iter(why(record)), record.status)
        words = f"but of the file of {problem.name} are not taken over: {acting}, which may be why; {REMEDY}"
        raise FileError(f"{path}: not judged: {reason}; {words}")
