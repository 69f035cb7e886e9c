"""Progress of a suite: on a terminal a bar, the time left, the worst drift and the running runs; else plain lines."""

import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from ..harness import machine
from ..harness.execution.eta import PREPARING, Estimate, describe_wait, durations, in_words
from ..harness.execution.job import Job
from ..harness.execution.pool import LocalPool
from ..harness.execution.runner import Executor, Request, run_suite
from ..harness.results.records import RunRecord
from ..harness.results.store import Loaded, Unreadable
from ..harness.results.words import why
from ..harness.sandbox.isolation import describe_lacking
from ..harness.types import Status
from .terminal import error_console, list_unreadable, plural, status_style

LISTED = 50  # at most so many runs that were not started
BAR = 30  # characters
SHOWN = 8  # at most so many running runs
PATIENCE = 3.0  # [s] of compilation and references until they are mentioned
EVERY = 30.0  # [s] between two progress lines where there is no bar


class Watch:
    """Prints one line per finished run, and keeps the status lines at the bottom of a terminal."""

    def __init__(self, console: Console, live: Live | None, size: int = 1, *, resumable: bool = True) -> None:
        self.console, self.live, self.size, self.resumable = console, live, size, resumable
        self.total = self.before = self.done = 0
        self.opened = self.reported = time.monotonic()
        self.begun = math.inf  # when the first run began
        self.waiting: dict[str, Job] = {}
        self.running: dict[str, tuple[Job, float]] = {}
        self.estimate = Estimate({})
        self.warming = False  # no run has begun
        self.compiling = False  # and not mentioned yet
        self.worst = (0.0, "")
        self.left = 0  # runs not started because of total_limit

    def begin(self, folder: Path, total: int, waiting: Sequence[Job], unreadable: tuple[Unreadable, ...]) -> None:
        self.total, self.before = total, total - len(waiting)
        self.waiting = {job.id: job for job in waiting}
        self.warming = bool(waiting)
        further = bool(self.before) and not self.resumable  # a later stage of the same command
        self.compiling = self.warming and not further
        self.estimate = Estimate(durations(suite=waiting[0].suite) if waiting else {})
        kept = f", {self.before} already done" if self.before else ""
        if not further:
            self._say(f"{plural(total, 'run')}{kept}{f', results in {folder}' if self.resumable else ''}")
            if lacking := describe_lacking():
                self._say(lacking)
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
        self.running.pop(job.id, None)
        self.done += 1
        if record.wall_s > 0.0:
            self.estimate.learn(job.spec, record.wall_s)
        relative = record.energy_drift_max_J / record.energy_scale_J
        if record.status != Status.REFUSED and relative > self.worst[0]:
            self.worst = (relative, job.spec.case)
        words = f"{record.status:<14} {record.wall_s:6.1f} s  {job.spec.case}"
        if record.status not in (Status.SUCCESS, Status.REFUSED):
            because = why(record)
            words += f"  ({because[0]}{f', and {len(because) - 1} more' if because[1:] else ''})"
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
            self._say(describe_wait(PREPARING, now - self.opened))
        if self.live is not None:
            self.live.update(Group(*self.foot(now)), refresh=True)
        elif now - self.reported > EVERY and self.running:
            self.reported = now
            self._say(f"    {self.count()}; {self.drift()}" if self.worst[1] else f"    {self.count()}")

    def on_stop(self, left: Sequence[Job], limit: float) -> None:
        self.left = len(left)
        name = "the suite's total_limit" if self.resumable else "the budget"
        self._say(f"stopped at {name} of {limit:.3g} s", "yellow")
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
        self._say(f"{plural(len(loaded.records), 'run')}: {words} in {spent:.1f} s; {folder}/runs.parquet")
        if self.worst[1]:
            self._say(f"largest energy drift: {self.drift()}")

    def foot(self, now: float) -> list[Text]:
        """The status lines, none wider than the terminal."""
        share = (self.before + self.done) / self.total if self.total else 0.0
        full = round(share * BAR)
        lines = [Text.assemble(("━" * full, "green"), ("─" * (BAR - full), "dim"), f" {self.count()}")]
        if self.worst[1]:
            lines.append(Text(f"worst drift: {self.drift()}"))
        for job, since in list(self.running.values())[:SHOWN]:
            guess = self.estimate.guess(job.spec)
            of = f" of about {in_words(guess)}" if guess is not None else ""
            lines.append(Text(f"  {now - since:.0f} s{of}: {job.spec.case}", "dim"))
        if self.warming:
            lines.append(Text(f"  {describe_wait(PREPARING, now - self.opened)}", "dim"))
        for line in lines:
            line.no_wrap, line.overflow = True, "ellipsis"
        return lines

    def count(self) -> str:
        """The number of finished runs, and the time left."""
        now = time.monotonic()
        running = [(job.spec, now - since) for job, since in self.running.values()]
        left = self.estimate.estimate_left(running, (job.spec for job in self.waiting.values()), self.size)
        words = "" if left is None or not (running or self.waiting) else f", about {in_words(left)} left"
        return f"{self.before + self.done} of {self.total}{words}"

    def drift(self) -> str:
        """The largest so far."""
        return f"{self.worst[0]:.2g} of the energy scale, {self.worst[1]}"

    def _say(self, words: str, style: str = "") -> None:
        self.console.print(Text(words, style), highlight=False, soft_wrap=True)


def warn_of_own_bits() -> None:
    """Print a line where runs of this machine will not have the bits that they have elsewhere, unless natively."""
    if words := machine.explain_deviations():
        error_console().print(words)


def run_watched(
    request: Request, *, quiet: bool, resumable: bool = True, pool: Callable[..., Executor] = LocalPool
) -> tuple[Loaded, Watch]:
    """Run a suite under a ``Watch``: with status lines on a terminal; ``quiet``: one that prints nothing.

    What is not ``resumable`` has a budget, and a folder that is of no use to the user or is named elsewhere.
    """
    console = Console(quiet=quiet)
    plain = quiet or not console.is_terminal or console.is_dumb_terminal
    with nullcontext() if plain else Live(console=console, auto_refresh=False, transient=True) as live:
        watcher = Watch(console, live, request.jobs, resumable=resumable)
        return run_suite(request, watcher, pool), watcher
