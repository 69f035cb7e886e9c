"""Write a results folder as one file that anybody can check (``bundle``)."""

import argparse

from ...harness.lab.bundle.archive import write_archive
from ...harness.lab.bundle.contents import list_contents
from ...harness.results import store
from ..arguments import UsageError, count_jobs, load_plugins
from ..full_series import find_brief_runs, provide_full_series
from ..terminal import make_console, plural, print_json, print_unreadable


def run(arguments: argparse.Namespace) -> int:
    """Write the bundle, with --lossless after solving again the runs whose results lack steps or states.

    Return 1 if a record could not be read and is left out, else 0.
    """
    folder, out = arguments.results, arguments.out
    loaded = store.load(folder)
    records = store.select_newest(loaded.records)
    if not records:
        raise UsageError(f"{folder} holds no results")
    plugins = load_plugins(arguments.plugin)
    lacking = find_brief_runs(folder, records) if arguments.lossless else []
    with provide_full_series(folder, lacking, count_jobs(arguments.jobs), plugins, lossless=True) as again:
        files = write_archive(out, list_contents(folder, records, lossless=arguments.lossless, again=again))
    size = out.stat().st_size
    if arguments.json:
        print_json({"file": str(out), "runs": len(records), "bytes": size, "left_out": len(loaded.unreadable)})
    else:
        make_console().print(f"{out}: {plural(len(records), 'run')}, {plural(files, 'file')}, {size / 1e6:.2f} MB")
        print_unreadable(loaded.unreadable, make_console())
    return 1 if loaded.unreadable else 0
