"""Solve runs again for steps that results lack, and print a line that says so."""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ..harness.results import store
from ..harness.results.records import RunRecord
from ..harness.results.series import Series
from ..harness.run.full_series import solve_every_step
from ..harness.run.runner import Request
from .progress import run_watched
from .terminal import make_error_console, plural


def find_brief_runs(folder: Path, records: Sequence[RunRecord]) -> list[RunRecord]:
    """Return those of ``records``, in the results folder ``folder``, whose stored series lack steps or states."""
    kept = ((r, store.read_run_series(folder, r, poses=False)) for r in records)
    return [r for r, series in kept if series is not None and series.is_brief]


@contextmanager
def provide_full_series(
    folder: Path, records: Sequence[RunRecord], jobs: int, plugins: tuple[str, ...], *, lossless: bool
) -> Iterator[dict[str, Series]]:
    """Yield the series of ``records`` with every step, by run_id; with ``lossless`` they have every state, too.

    The runs of the results folder are solved again, ``jobs`` at a time, in a temporary folder that is removed when the
    context ends. Without records, nothing is run and the dict is empty.
    """
    with tempfile.TemporaryDirectory() as place:

        def run(request: Request) -> None:
            """Print that runs are solved again and how long they took before, and run the suite."""
            seconds = sum(r.cpu_process_s for r in records if r.cpu_process_s > 0.0)
            took = f", which took {seconds:.2g} s of CPU time" if seconds else ""
            words = f"{plural(len(records), 'run')} of these results"
            make_error_console().print(f"not every step is kept: solving {words} again{took}", highlight=False)
            run_watched(request, quiet=True, resumable=False)

        yield (
            solve_every_step(folder, records, Path(place) / "run", jobs, run, plugins, lossless=lossless)
            if records
            else {}
        )
