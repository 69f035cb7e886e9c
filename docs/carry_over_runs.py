"""Make the runs by which ``carry_over.py`` compares two states of the code: ``python carry_over_runs.py FOLDER SEED``.

This is a separate file because it runs with the package of either state, and imports nothing that one may lack.
"""

import hashlib
import json
import os
import sys
from pathlib import Path
from unittest.mock import MagicMock  # an observer that prints nothing

from mbsbench.harness.catalogue import codes
from mbsbench.harness.catalogue.suites.suite import Suite, load_suite
from mbsbench.harness.judge.referee.currency import JUDGING
from mbsbench.harness.judge.referee.judge import judge_results
from mbsbench.harness.run.runner import Request, run_suite

DRAWN = 100


def main(folder: Path, seed: str) -> None:
    """Make the runs in ``folder``; print the digests of the code and the verdicts on claims, as JSON.

    The runs are those of suite ``ci``, a hundred of ``referee`` drawn by ``seed``, and one of each problem and solver
    not drawn. The draw is by digests, so that a suite with some runs more or less draws nearly the same.
    """
    known = sorted(
        load_suite("referee").specs, key=lambda s: hashlib.sha256(f"{seed} {s.settings_id}".encode()).hexdigest()
    )
    drawn = [*load_suite("ci").specs, *known[:DRAWN]]
    for name in ("problem", "solver"):  # one of each, engines too: others could not be carried over
        met = {getattr(s, name) for s in drawn}
        others = [*known, *load_suite("bench_engines").specs]
        drawn += {getattr(s, name): s for s in others if getattr(s, name) not in met}.values()
    suite = Suite("carried", "runs by two states of the code", tuple({s.settings_id: s for s in drawn}.values()), "")
    run_suite(Request(suite, folder, os.cpu_count() or 1), MagicMock())
    here = codes.package_sources()
    digests = {"solvers": here.solvers, "problems": here.problems, "measuring": here.measuring}
    digests |= {"running": here.running, "columns": here.columns.columns}
    claims = judge_results(folder)["claims"]
    verdicts = {c.id: [c.verdicts, *([f.holds, f.settings, f.rows] for f in c.findings)] for c in claims}
    sys.stdout.write(json.dumps({**digests, "judging": here.digest_modules(*JUDGING), "verdicts": verdicts}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
