"""Steps that results lack, solved again on demand, with a line that says so."""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ..harness.execution.again import solve_again
from ..harness.execution.runner import Request
from ..harness.results import store
from ..harness.results.records import RunRecord
from ..harness.results.series import Series
from .progress import run_watched
from .terminal import error_console, plural


def find_brief(folder: Path, records: Sequence[RunRecord]) -> list[RunRecord]:
    """The runs whose series keep not every step and state."""
    kept = ((r, store.series_of(folder, r, poses=False)) for r in records)
    return [r for r, series in kept if series is not None and series.is_brief]


@contextmanager
def solved_again(
    folder: Path, records: Sequence[RunRecord], jobs: int, plugins: tuple[str, ...], *, lossless: bool
) -> Iterator[dict[str, Series]]:
    """The series of ``records`` with every step; with ``lossless`` every state too."""
    with tempfile.TemporaryDirectory() as place:

        def run(request: Request) -> None:
            seconds = sum(r.cpu_process_s for r in records if r.cpu_process_s > 0.0)
            took = f", which took {seconds:.2g} s of CPU time" if seconds else ""
            words = f"{plural(len(records), 'run')} of these results"
            error_console().print(f"not every step is kept: solving {words} again{took}", highlight=False)
            run_watched(request, quiet=True, resumable=False)

        yield (
            solve_again(folder, records, Path(place) / "run", jobs, run, plugins, lossless=lossless) if records else {}
        )
