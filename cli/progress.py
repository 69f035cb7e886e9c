"""Show the progress of a suite: on a terminal a bar with time left and worst drift, else plain lines."""

import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path

from rich.console import Group
from rich.live import Live
from rich.text import Text

from ..harness.base import machine
from ..harness.base.isolation import describe_missing_protection
from ..harness.catalogue.suites.spec import RunSpec
from ..harness.mechanics.types import Status
from ..harness.results.records import RunRecord
from ..harness.results.store import LoadedResults
from ..harness.results.words import list_reasons, qualify_status
from ..harness.run.costs import predict_times
from ..harness.run.job import Job
from ..harness.run.remaining_time import PREPARING, describe_wait, format_duration
from ..harness.run.runner import Request, run_suite
from .terminal import Console, choose_status_style, list_unreadable, make_error_console, plural

LISTED = 50  # most runs listed that were not started
BAR = 30  # characters
SHOWN = 8  # most running runs shown
PATIENCE = 3.0  # [s] of compilation or references after which they are mentioned
EVERY = 30.0  # [s] between two progress lines without a bar


class ProgressDisplay:
    """An observer that prints one line per finished run and keeps status lines at the bottom of a terminal."""

    def __init__(
        self,
        console: Console,
        live: Live | None,
        size: int = 1,
        *,
        resumable: bool = True,
        announces: bool = True,
        is_local: bool = True,
        budget: str = "",
        later: int = 0,
        afterwards: str = "",
    ) -> None:
        """Start the display of a suite that runs ``size`` jobs at a time; ``live`` is None without a terminal."""
        self.budget = budget  # words on the limit of a command that runs several suites
        self.later = later  # runs of the suite that this command leaves to a later one
        self.afterwards = afterwards  # words on what commands that follow will take
        self.console, self.live, self.size, self.resumable = console, live, size, resumable
        self.is_local = is_local  # True if runs are on this machine, whose speed is known
        self.announces = announces  # True to announce the suite; a command with several suites does so itself
        self.total = self.before = self.done = 0  # runs of the suite, finished earlier, finished now
        self.opened = self.reported = time.monotonic()  # start of the display, and of the last progress line
        self.begun = math.inf  # when the first run began
        self.waiting: dict[str, Job] = {}
        self.running: dict[str, tuple[Job, float]] = {}  # each with its start (time.monotonic)
        self.estimate = predict_times([], size)
        self.warming = False  # True while no run has begun
        self.compiling = False  # True while the wait for the first run is not mentioned
        self.worst = (0.0, "", "")  # largest energy drift relative to its energy scale, its run, and that run's status
        self.left = 0  # runs not started because of total_limit
        self.set_aside: Mapping[Path, str] = {}  # before any run began

    def begin(self, folder: Path, total: int, waiting: Sequence[Job], unreadable: Mapping[Path, str]) -> None:
        """Print the number of runs, their expected time on this machine, and the unreadable files that are set aside.

        ``waiting`` are the runs without a result, of ``total`` in the suite.
        """
        self.total, self.before = total, total - len(waiting)
        self.waiting = {job.id: job for job in waiting}
        self.warming = bool(waiting)
        further = bool(self.before) and not self.resumable  # True for a later stage of the same command
        self.compiling = self.warming and not further
        expected = predict_times([job.spec for job in waiting], self.size, waiting[0].suite if waiting else "")
        self.estimate = expected
        kept = f", {self.before} already done" if self.before else ""
        if self.announces and not further:
            where = f"; results in {folder}" if self.resumable else ""
            time_needed = expected.words_after_count + self.afterwards * bool(waiting) if self.is_local else ""
            announce_suite(f"{plural(total, 'run')}{kept}{time_needed}{where}", self.console)
        self.set_aside = unreadable
        for line in list_unreadable("set aside", [(path.name, why) for path, why in unreadable.items()]):
            self._print_line(line)
        self.on_tick()

    def on_start(self, job: Job) -> None:
        """Move a run from the waiting to the running ones."""
        self.compiling = self.warming = False
        self.begun = min(self.begun, time.monotonic())
        self.waiting.pop(job.id, None)
        self.running[job.id] = (job, time.monotonic())
        self.on_tick()

    def on_end(self, job: Job, record: RunRecord) -> None:
        """Print how a run ended and why; update the estimate of times and the largest energy drift.

        A run that lacks a package is not printed if the command itself names missing packages (``announces`` False).
        """
        begun = self.running.pop(job.id, None)
        self.done += 1
        if begun and record.wall_s > 0.0:
            self.estimate.note_time(job.spec, time.monotonic() - begun[1])
        relative = record.energy_drift_max_J / record.energy_scale_J
        if record.status != Status.REFUSED and relative > self.worst[0]:
            self.worst = (relative, job.spec.case, record.status)
        words = f"{record.status:<14} {record.wall_s:6.1f} s  {job.spec.case}"
        said = [qualify_status(record)]
        if record.status == Status.REFUSED:
            said.insert(0, record.message)
        elif record.status != Status.SUCCESS:
            because = list_reasons(record)
            said.insert(0, f"{because[0]}{f', and {len(because) - 1} more' if because[1:] else ''}")
        if beside := "; ".join(filter(None, said)):
            words += f"  ({beside})"
        if record.missing_package and not self.announces:
            return
        count = f"[{self.before + self.done}/{self.total}]"
        self._print_line(f"{count} {words}", choose_status_style(record.status))
        self.on_tick()

    def on_warmup(self, times: dict[str, float], references: dict[str, float]) -> None:
        """Print each compilation and each reference, by name and time [s], that took longer than ``PATIENCE``."""
        for done, spent in (("compiled", times), ("reference computed", references)):
            for name, seconds in spent.items():
                if seconds > PATIENCE:
                    self._print_line(f"{done} in {seconds:.0f} s, not counted in any run: {name}")

    def on_tick(self) -> None:
        """Draw the status lines of a terminal anew; without one, print a line of progress every ``EVERY`` seconds."""
        now = time.monotonic()
        if self.compiling and now - self.opened > PATIENCE:
            self.compiling = False
            if self.estimate.once > PATIENCE:  # otherwise the time is that of loading, as at every start
                self._print_line(describe_wait(PREPARING, now - self.opened, self.estimate.once))
        if self.live is not None:
            self.live.update(Group(*self.format_status(now)), refresh=True)
        elif now - self.reported > EVERY and self.running:
            self.reported = now
            drift = f"; largest energy drift: {self.describe_drift()}" if self.worst[1] else ""
            self._print_line(f"    {self.describe_count()}{drift}")

    def on_stop(self, left: Sequence[Job], limit: float) -> None:
        """Print that a time limit [s] ended the suite, and the runs ``left`` that were not started."""
        self.left = len(left)
        reached = self.budget or f"the suite's total_limit of {limit:.3g} s"
        self._print_line(f"stopped at {reached}", "yellow")
        for job in left[:LISTED]:
            self._print_line(f"not started: {job.spec.case}")
        if left:
            more = f" ({len(left) - LISTED} more are not listed)" if left[LISTED:] else ""
            again = "; --resume runs them" if self.resumable else ""
            self._print_line(f"{plural(len(left), 'run')} not started, without a result{again}{more}")

    def finish(self, folder: Path, loaded: LoadedResults) -> None:
        """Print the last lines: the number of runs by status, and the path of the results."""
        counted = Counter(r.status for r in loaded.records)
        words = ", ".join(f"{n} {status}" for status, n in counted.most_common())
        spent = time.monotonic() - self.opened
        out = Console(quiet=self.console.quiet, highlight=False, markup=False, soft_wrap=True)
        out.print(f"{plural(len(loaded.records), 'run')}: {words} in {spent:.1f} s; {folder}/runs.parquet")
        if self.worst[1]:
            out.print(f"largest energy drift: {self.describe_drift()}")

    def format_status(self, now: float) -> list[Text]:
        """Return the status lines at ``now`` (of time.monotonic): a bar, the worst drift, the running runs."""
        full = round(self.estimate.compute_done_fraction(self._list_running(), self._list_waiting()) * BAR)
        lines = [Text.assemble(("━" * full, "green"), ("─" * (BAR - full), "dim"), f" {self.describe_count()}")]
        if self.worst[1]:
            lines.append(Text(f"worst drift: {self.describe_drift()}"))
        for job, since in list(self.running.values())[:SHOWN]:
            whole = format_duration(now - since + self.estimate.estimate_remaining(job.spec, now - since))
            lines.append(Text(f"  {now - since:.0f} s of about {whole}: {job.spec.case}", "dim"))
        if self.warming:
            lines.append(Text(f"  {describe_wait(PREPARING, now - self.opened, self.estimate.once)}", "dim"))
        for line in lines:
            line.no_wrap, line.overflow = True, "ellipsis"
        return lines

    def describe_count(self) -> str:
        """Return words on the finished runs, the percentage of the work that is done, and the time left.

        Without runs left they are the number of finished runs alone.
        """
        running, waiting = self._list_running(), self._list_waiting()
        words = f"{self.before + self.done} of {plural(self.total, 'run')}"
        if not (running or waiting):
            return words
        share, left = self.estimate.compute_done_fraction(running, waiting), self._estimate_left(running, waiting)
        later = (
            f"; {plural(self.later, 'run')} of the suite follow{'s' if self.later == 1 else ''}" if self.later else ""
        )
        return f"{words}, {100.0 * share:.0f} % of the work, about {format_duration(left)} left{later}"

    def _estimate_left(self, running: Sequence[tuple[RunSpec, float]], waiting: Sequence[RunSpec]) -> float:
        """Return the wall time that the running and the waiting runs still take [s]."""
        return self.estimate.estimate_time_left(running, waiting, self.size)

    def _list_running(self) -> list[tuple[RunSpec, float]]:
        """Return the running runs, each with the wall time since its start [s]."""
        now = time.monotonic()
        return [(job.spec, now - since) for job, since in self.running.values()]

    def _list_waiting(self) -> list[RunSpec]:
        """Return the runs that were not started yet."""
        return [job.spec for job in self.waiting.values()]

    def describe_drift(self) -> str:
        """Return words on the largest energy drift so far, relative to its run's energy scale, with run and status."""
        share, case, status = self.worst
        return f"{share:.2g} of the energy scale, {case} ({status})"

    def _print_line(self, words: str, style: str = "") -> None:
        """Print a line above the status lines."""
        self.console.print(Text(words, style), highlight=False, soft_wrap=True)


def warn_of_deviating_bits() -> None:
    """Print a line if runs on this machine do not agree bit for bit with those on other machines."""
    if words := machine.explain_deviations():
        make_error_console().print(words)


def announce_suite(words: str, out: Console) -> None:
    """Print the plan of a command, given in ``words``, and the means of confining runs that this system lacks."""
    for line in filter(None, (words, describe_missing_protection())):
        out.print(Text(line), highlight=False, soft_wrap=True)


def run_watched(
    request: Request,
    *,
    quiet: bool,
    resumable: bool = True,
    announces: bool = True,
    is_local: bool = True,
    budget: str = "",
    afterwards: str = "",
) -> tuple[LoadedResults, ProgressDisplay]:
    """Run a suite with progress on standard error, unless ``quiet``; return its results and the display.

    On a terminal there are status lines, elsewhere plain lines. Of a suite that is not ``resumable`` no line offers
    --resume. With ``announces=False`` the command itself has printed what it will run. With ``is_local=False`` the runs
    are on a cluster and take an unknown time. ``budget`` names in words the command's own limit, in place of the
    suite's total_limit; ``afterwards`` says how long the commands that usually follow will take.
    """
    console = Console(quiet=quiet, stderr=True)
    plain = quiet or not console.is_terminal or console.is_dumb_terminal
    with nullcontext() if plain else Live(console=console, auto_refresh=False, transient=True) as live:
        later = len(request.suite.specs) - len(request.suite.parts[request.only]) if request.only else 0
        watcher = ProgressDisplay(
            console,
            live,
            request.jobs,
            resumable=resumable,
            announces=announces,
            is_local=is_local,
            budget=budget,
            later=later,
            afterwards=afterwards,
        )
        return run_suite(request, watcher), watcher
