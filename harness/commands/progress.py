"""How a run goes, on the terminal: a bar with what runs, what is left and the time to go; plain lines elsewhere."""

import json
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from harness.job import Job
from harness.records import RunRecord
from harness.store import Loaded, Unreadable
from harness.types import Status

LISTED = 50  # cells named at most
STYLE = {Status.SUCCESS: "green", Status.REFUSED: "cyan", Status.WRONG: "bold red"}


class Watch:
    """Prints one line a finished cell, and keeps the bar."""

    def __init__(self, console: Console, bar: Progress | None) -> None:
        self.console, self.bar = console, bar
        self.task = bar.add_task("", total=None, left="") if bar else None
        self.total = self.before = self.done = 0
        self.opened = self.began = time.monotonic()
        self.running: dict[str, tuple[Job, float]] = {}
        self.worst = (0.0, "")
        self.left = 0  # cells that a limit on the whole run has kept from beginning

    def begin(self, folder: Path, total: int, done: int, unreadable: tuple[Unreadable, ...]) -> None:
        self.total, self.before, self.began = total, done, time.monotonic()
        kept = f", {done} of them done before" if done else ""
        self._say(f"{total} cells{kept} into {folder}")
        for item in unreadable:
            self._say(f"set aside: {item.path.name}: {item.why}")
        self.tick()

    def started(self, job: Job) -> None:
        self.running[job.id] = (job, time.monotonic())
        self.tick()

    def ended(self, job: Job, record: RunRecord) -> None:
        self.running.pop(job.id, None)
        self.done += 1
        relative = record.energy_drift_max_J / record.energy_scale_J
        if record.status != Status.REFUSED and relative > self.worst[0]:
            self.worst = (relative, job.cell.case)
        words = f"{record.status:<14} {record.wall_s:6.1f} s  {job.cell.case}"
        if record.status not in (Status.SUCCESS, Status.REFUSED):
            because = json.loads(record.wrong_because) or [record.message]
            words += f"  ({because[0]}{f', and {len(because) - 1} more' if because[1:] else ''})"
        count = f"[{self.before + self.done}/{self.total}]"
        self._say(f"{count} {words}", STYLE.get(Status(record.status), "yellow"))
        self.tick()

    def warmed(self, times: dict[str, float]) -> None:
        slow = [f"{solver} {seconds:.0f} s" for solver, seconds in times.items() if seconds > 3.0]
        if slow:
            self._say(f"compiled once, before any clock runs: {', '.join(slow)}")
        self.began = time.monotonic()

    def tick(self) -> None:
        if self.bar is None or self.task is None:
            return
        now = time.monotonic()
        running = " | ".join(f"{j.cell.case} {now - t:.0f} s" for j, t in self.running.values())
        self.bar.update(
            self.task,
            total=self.total,
            completed=self.before + self.done,
            description=running or "starting",
            left=self._left(),
        )
        self.bar.refresh()

    def stopped(self, left: Sequence[Job], limit: float) -> None:
        self.left = len(left)
        self._say(f"stopped at the limit of {limit:g} s for the whole run (total_limit)", "yellow")
        for job in left[:LISTED]:
            self._say(f"left: {job.cell.case}")
        if left:
            more = f" ({len(left) - LISTED} more are not listed)" if left[LISTED:] else ""
            self._say(f"{len(left)} cells were not begun and have no result; --resume runs them{more}")

    def finish(self, folder: Path, loaded: Loaded) -> None:
        """The last line: how many ended how, and where they are."""
        counted = Counter(r.status for r in loaded.records)
        words = ", ".join(f"{n} {status}" for status, n in counted.most_common())
        self._say(
            f"{len(loaded.records)} cells: {words} in {time.monotonic() - self.opened:.1f} s; {folder}/cells.parquet"
        )
        if self.worst[1]:
            self._say(f"largest energy drift: {self.worst[0]:.2g} of the energy scale, {self.worst[1]}")

    def _left(self) -> str:
        left = self.total - self.before - self.done
        if not self.done:
            return f"{left} left"
        rate = (time.monotonic() - self.began) / self.done
        return f"{left} left, about {rate * left:.0f} s"

    def _say(self, words: str, style: str = "") -> None:
        self.console.print(words, style=style or None, highlight=False, markup=False, soft_wrap=True)


@contextmanager
def progress(*, quiet: bool = False) -> Iterator[Watch]:
    """A ``Watch`` with a bar if standard output is a terminal; ``quiet`` leaves it to what follows."""
    console = Console(quiet=quiet)
    if not console.is_terminal:
        yield Watch(console, None)
        return
    columns = (
        BarColumn(30),
        MofNCompleteColumn(),
        TextColumn("{task.fields[left]}"),
        TextColumn("{task.description}", markup=False),
    )
    bar = Progress(*columns, console=console, auto_refresh=False, transient=True)
    with bar:
        task = Watch(console, bar)
        yield task
