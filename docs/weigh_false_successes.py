"""Weigh published false successes and broken symmetries again: ``python docs/weigh_false_successes.py [RESULTS]``.

After a change of what misleads (``harness/results/misleading.py``, ``judge/referee/false_successes.py``)
this makes the few runs of suite ``referee`` whose errors decide, in the folder RESULTS, which may hold some of them
already, and writes ``symmetries.json`` and ``wrong.json`` of ``results/published/`` anew. Bounds and all other verdicts
stay as they were published, so they have to be of the present code: that is checked first.
"""

import os
import sys
from pathlib import Path

from mbsbench.cli.progress import run_watched
from mbsbench.harness.base.files import FileError
from mbsbench.harness.catalogue.suites.suite import Suite
from mbsbench.harness.judge.referee import judge as judging
from mbsbench.harness.judge.referee.weighing import list_deciding_runs, weigh_published
from mbsbench.harness.results import store
from mbsbench.harness.results.judgements.files import PUBLISHED, SYMMETRIES, WRONG, format_judgement, read_judgement
from mbsbench.harness.results.provisional import select_latest
from mbsbench.harness.run.runner import Request, find_last_folder, name_new_folder

NAME = "weighed"  # of the suite and of its folder
DESCRIPTION = "runs that decide which false successes mislead"


def main(words: list[str]) -> int:
    """Make the runs, write both files, and print what changed; return 0."""
    if outdated := judging.describe_outdated(PUBLISHED):
        raise FileError(outdated)
    symmetries, wrong = read_judgement(SYMMETRIES, PUBLISHED), read_judgement(WRONG, PUBLISHED)
    deciding = list_deciding_runs(symmetries, wrong)
    specs = tuple(s for s in judging.list_published_runs() if s.settings_id in deciding)
    folder = Path(words[0]) if words else find_last_folder(NAME) or name_new_folder(NAME)
    request = Request(Suite(NAME, DESCRIPTION, specs, ""), folder, os.cpu_count() or 1, resume=True)
    loaded, watcher = run_watched(request, quiet=False)
    watcher.finish(folder, loaded)
    with store.hold_folder(folder):
        rows, found = weigh_published(folder, select_latest(loaded.records), symmetries, wrong)
    for file, judged in ((SYMMETRIES, rows), (WRONG, found)):
        (PUBLISHED / f"{file.name}.json").write(format_judgement(judged))
    before, after = {w.settings_id for w in wrong}, {w.settings_id for w in found}
    for w in wrong:
        if w.settings_id not in after:
            _say(f"no false success: {w.case}")
    for w in found:
        if w.settings_id not in before:
            _say(f"now a false success: {w.case}")
    broken = [s for s in rows if s.verdict == "broken"]
    _say(
        f"{len(found)} false successes, {len(wrong)} before; {len(broken)} symmetries are broken, of which "
        f"{sum(s.contradicts for s in broken)} mislead"
    )
    return 0


def _say(words: str) -> None:
    sys.stderr.write(f"{words}\n")


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except FileError as error:
        sys.exit(str(error))
