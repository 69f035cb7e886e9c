"""Progress of a suite: on a terminal a bar, the time left, the worst drift and the running runs; else plain lines."""

import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path

from rich.console import Group
from rich.live import Live
from rich.text import Text

from ..harness import machine
from ..harness.execution.costs import Expectation, expect
from ..harness.execution.eta import PREPARING, Estimate, describe_wait, in_words
from ..harness.execution.job import Job
from ..harness.execution.pool import LocalPool
from ..harness.execution.runner import Executor, Request, run_suite
from ..harness.results.records import RunRecord
from ..harness.results.store import Loaded, Unreadable
from ..harness.results.words import comparison_words, why
from ..harness.sandbox.isolation import describe_lacking
from ..harness.suites.spec import RunSpec
from ..harness.types import Status
from .terminal import Console, error_console, list_unreadable, plural, status_style

LISTED = 50  # at most so many runs that were not started
BAR = 30  # characters
SHOWN = 8  # at most so many running runs
PATIENCE = 3.0  # [s] of compilation and references until they are mentioned
EVERY = 30.0  # [s] between two progress lines where there is no bar


class Watch:
    """Prints one line per finished run, and keeps the status lines at the bottom of a terminal."""

    def __init__(
        self, console: Console, live: Live | None, size: int = 1, *, resumable: bool = True, announces: bool = True,
        here: bool = True, budget: str = "",
    ) -> None:  # fmt: skip
        self.budget = budget  # words on the limit of a command that runs several suites within one
        self.console, self.live, self.size, self.resumable = console, live, size, resumable
        self.here = here  # whether runs are run on this machine, whose pace is known
        self.announces = announces  # what will be done; a command that runs several suites does so itself
        self.total = self.before = self.done = 0
        self.opened = self.reported = time.monotonic()
        self.begun = math.inf  # when the first run began
        self.waiting: dict[str, Job] = {}
        self.running: dict[str, tuple[Job, float]] = {}
        self.estimate, self.once = Estimate({}), 0.0
        self.warming = False  # no run has begun
        self.compiling = False  # and not mentioned yet
        self.worst = (0.0, "")
        self.left = 0  # runs not started because of total_limit
        self.set_aside: tuple[Unreadable, ...] = ()  # before any run began

    def begin(self, folder: Path, total: int, waiting: Sequence[Job], unreadable: tuple[Unreadable, ...]) -> None:
        self.total, self.before = total, total - len(waiting)
        self.waiting = {job.id: job for job in waiting}
        self.warming = bool(waiting)
        further = bool(self.before) and not self.resumable  # a later stage of the same command
        self.compiling = self.warming and not further
        expected = expect([job.spec for job in waiting], self.size, waiting[0].suite if waiting else "")
        self.estimate, self.once = Estimate(expected.runs), expected.once
        kept = f", {self.before} already done" if self.before else ""
        if self.announces and not further:
            where = f"; results in {folder}" if self.resumable else ""
            time_needed = describe_time(expected) if self.here else ""
            announce(f"{plural(total, 'run')}{kept}{time_needed}{where}", self.console)
        self.set_aside = unreadable
        for line in list_unreadable("set aside", [(item.path.name, item.why) for item in unreadable]):
            self._say(line)
        self.tick()

    def on_start(self, job: Job) -> None:
        self.compiling = self.warming = False
        self.begun = min(self.begun, time.monotonic())
        self.waiting.pop(job.id, None)
        self.running[job.id] = (job, time.monotonic())
        self.tick()

    def on_end(self, job: Job, record: RunRecord) -> None:
        begun = self.running.pop(job.id, None)
        self.done += 1
        if begun and record.wall_s > 0.0:
            self.estimate.learn(job.spec, time.monotonic() - begun[1])
        relative = record.energy_drift_max_J / record.energy_scale_J
        if record.status != Status.REFUSED and relative > self.worst[0]:
            self.worst = (relative, job.spec.case)
        words = f"{record.status:<14} {record.wall_s:6.1f} s  {job.spec.case}"
        if record.status not in (Status.SUCCESS, Status.REFUSED):
            because = why(record)
            words += f"  ({because[0]}{f', and {len(because) - 1} more' if because[1:] else ''})"
        elif record.status == Status.SUCCESS and (compared := comparison_words(record)):
            words += f"  ({compared})"
        if record.missing_package and not self.announces:  # the command itself names what is not installed
            return
        count = f"[{self.before + self.done}/{self.total}]"
        self._say(f"{count} {words}", status_style(record.status))
        self.tick()

    def on_warmup(self, times: dict[str, float], references: dict[str, float]) -> None:
        for done, spent in (("compiled", times), ("reference computed", references)):
            for name, seconds in spent.items():
                if seconds > PATIENCE:
                    self._say(f"{done} in {seconds:.0f} s, not counted in any run: {name}")

    def tick(self) -> None:
        now = time.monotonic()
        if self.compiling and now - self.opened > PATIENCE:
            self.compiling = False
            if self.once > PATIENCE:  # else it is loading, which every start does
                self._say(describe_wait(PREPARING, now - self.opened, self.once))
        if self.live is not None:
            self.live.update(Group(*self.foot(now)), refresh=True)
        elif now - self.reported > EVERY and self.running:
            self.reported = now
            drift = f"; largest energy drift: {self.drift()}" if self.worst[1] else ""
            self._say(f"    {self.count()}{drift}")

    def on_stop(self, left: Sequence[Job], limit: float) -> None:
        self.left = len(left)
        reached = self.budget or f"the suite's total_limit of {limit:.3g} s"
        self._say(f"stopped at {reached}", "yellow")
        for job in left[:LISTED]:
            self._say(f"not started: {job.spec.case}")
        if left:
            more = f" ({len(left) - LISTED} more are not listed)" if left[LISTED:] else ""
            again = "; --resume runs them" if self.resumable else ""
            self._say(f"{plural(len(left), 'run')} not started, without a result{again}{more}")

    def finish(self, folder: Path, loaded: Loaded) -> None:
        """The last lines: how many runs have which status, and where they are."""
        counted = Counter(r.status for r in loaded.records)
        words = ", ".join(f"{n} {status}" for status, n in counted.most_common())
        spent = time.monotonic() - self.opened
        out = Console(quiet=self.console.quiet, highlight=False, markup=False, soft_wrap=True)
        out.print(f"{plural(len(loaded.records), 'run')}: {words} in {spent:.1f} s; {folder}/runs.parquet")
        if self.worst[1]:
            out.print(f"largest energy drift: {self.drift()}")

    def foot(self, now: float) -> list[Text]:
        """The status lines, none wider than the terminal."""
        full = round(self.estimate.share_done(self._list_running(), self._list_waiting()) * BAR)
        lines = [Text.assemble(("━" * full, "green"), ("─" * (BAR - full), "dim"), f" {self.count()}")]
        if self.worst[1]:
            lines.append(Text(f"worst drift: {self.drift()}"))
        for job, since in list(self.running.values())[:SHOWN]:
            of = in_words(now - since + self.estimate.rest(job.spec, now - since))
            lines.append(Text(f"  {now - since:.0f} s of about {of}: {job.spec.case}", "dim"))
        if self.warming:
            lines.append(Text(f"  {describe_wait(PREPARING, now - self.opened, self.once)}", "dim"))
        for line in lines:
            line.no_wrap, line.overflow = True, "ellipsis"
        return lines

    def count(self) -> str:
        """The number of finished runs, the share of the work that is done, and the time left."""
        running, waiting = self._list_running(), self._list_waiting()
        words = f"{self.before + self.done} of {plural(self.total, 'run')}"
        if not (running or waiting):
            return words
        share, left = (f(running, waiting) for f in (self.estimate.share_done, self._estimate_left))
        return f"{words}, {100.0 * share:.0f} % of the work, about {in_words(left)} left"

    def _estimate_left(self, running: Sequence[tuple[RunSpec, float]], waiting: Sequence[RunSpec]) -> float:
        return self.estimate.estimate_left(running, waiting, self.size)

    def _list_running(self) -> list[tuple[RunSpec, float]]:
        now = time.monotonic()
        return [(job.spec, now - since) for job, since in self.running.values()]

    def _list_waiting(self) -> list[RunSpec]:
        return [job.spec for job in self.waiting.values()]

    def drift(self) -> str:
        """The largest so far."""
        return f"{self.worst[0]:.2g} of the energy scale, {self.worst[1]}"

    def _say(self, words: str, style: str = "") -> None:
        self.console.print(Text(words, style), highlight=False, soft_wrap=True)


def warn_of_own_bits() -> None:
    """Print a line where runs of this machine will not have the bits that they have elsewhere, unless natively."""
    if words := machine.explain_deviations():
        error_console().print(words)


def announce(words: str, out: Console) -> None:
    """Print what a command will do, before it does it, and what this machine lacks for that."""
    for line in filter(None, (words, describe_lacking())):
        out.print(Text(line), highlight=False, soft_wrap=True)


def describe_time(expected: Expectation) -> str:
    """Return the words on how long runs will take here, after their number; none where nothing is to be run."""
    return f", {expected.jobs} at a time: {expected.words}" if expected.runs else ""


def run_watched(
    request: Request, *, quiet: bool, resumable: bool = True, announces: bool = True, here: bool = True,
    budget: str = "", pool: Callable[..., Executor] = LocalPool,
) -> tuple[Loaded, Watch]:  # fmt: skip
    """Run a suite under a ``Watch`` on standard error, with status lines on a terminal; ``quiet``: without a word.

    What is not ``resumable`` has a folder that is of no use to the user or is named elsewhere, and perhaps a
    ``budget``, in words; runs that are not run ``here`` but on a cluster take an unknown time.
    """
    console = Console(quiet=quiet, stderr=True)
    plain = quiet or not console.is_terminal or console.is_dumb_terminal
    with nullcontext() if plain else Live(console=console, auto_refresh=False, transient=True) as live:
        watcher = Watch(console, live, request.jobs, resumable=resumable, announces=announces, here=here, budget=budget)
        return run_suite(request, watcher, pool), watcher
