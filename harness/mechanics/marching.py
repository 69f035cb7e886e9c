"""Continue steps that Python asks for until the end of a problem, a limit or a failure, and say how that ended."""

from collections.abc import Callable

from .types import Problem, Status, StepControl


class StepFailure(Exception):
    """Raised where steps cannot continue, with the status and message of the run."""

    def __init__(self, status: Status, message: str) -> None:
        super().__init__(message)
        self.status, self.message = status, message


def march(
    times: list[float],
    problem: Problem,
    control: StepControl,
    check_clock: Callable[[], object],
    advance: Callable[[], object],
) -> tuple[Status, str]:
    """Call ``advance`` until the end of the problem, a limit or a failure; return status and message of the run.

    ``advance`` takes steps and appends the times [s] at their ends to ``times``, which begins with the start. Before
    each call ``check_clock`` is called; both may raise ``StepFailure``, which ends the run.
    """
    try:
        while times[-1] < problem.t_end:
            if len(times) > control.max_steps:
                raise StepFailure(Status.STALLED, f"the limit of {control.max_steps} accepted steps was reached")
            check_clock()
            advance()
    except StepFailure as failure:
        return failure.status, f"stopped at t = {times[-1]:.6g} s: {failure.message}"
    return Status.SUCCESS, "reached the end"
