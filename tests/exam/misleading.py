"""``python -m mbsbench.tests.exam.misleading RESULTS ...``: records whose status and errors contradict each other.

Called wrong with errors of motion, velocities and reactions within a hundredth of their sizes and no conserved quantity
off; or called a success with errors beyond what a success is allowed. Both tables have to be empty: else exit code 1.
Records have errors of joints' forces alone: where only ``reactions`` are accused, their moments may be what is off.
"""

import argparse
import math
import sys
from pathlib import Path

from mbsbench.harness.base.files import FileError
from mbsbench.harness.mechanics.types import ACCURATE, Status
from mbsbench.harness.results import store
from mbsbench.harness.results.misleading import agrees_with_reference, breaks_state_law
from mbsbench.harness.results.records import RunRecord

from .judging import laws_of


def shares(r: RunRecord) -> dict[str, float]:
    """Errors of motion, velocities and reactions over their sizes, as far as they are judged."""
    with_sizes = {
        "motion": (r.motion_error_judged_m - r.reference_own_error_judged_m, r.length_scale_m),
        "velocity": (r.rate_error_judged_m_per_s, r.speed_scale_m_per_s),
        "reactions": (r.reaction_error_max_N, r.reaction_size_N),
    }
    return {k: e / size for k, (e, size) in with_sizes.items() if not math.isnan(e) and size > 0.0}


def is_accused(r: RunRecord) -> bool:
    """Whether it is called wrong though it is right by comparison and keeps all laws of states."""
    because = r.reasons
    return r.status == Status.WRONG and agrees_with_reference(r) and not breaks_state_law(because)


def is_believed(r: RunRecord) -> bool:
    """Whether it is called a success though it is farther off than one may be."""
    most = {"motion": ACCURATE["accurate_until_s"], "velocity": 1.0, "reactions": 10.0}
    return r.status == Status.SUCCESS and any(v > most[k] for k, v in shares(r).items())


def print_table(folder: Path) -> int:
    """Print the contradictions of a results folder; their number."""
    records = store.select_newest(store.load(folder, check_series=False).records)
    found = [
        (words, [r for r in records if of(r)])
        for words, of in (
            ("called wrong, and right by comparison", is_accused),
            ("called a success, and far off", is_believed),
        )
    ]
    print(f"{folder}: {len(records)} runs")
    for words, those in found:
        print(f"  {words}: {len(those)}")
        for r in those:
            sizes = ", ".join(f"{k} {v:.2g}" for k, v in shares(r).items())
            print(f"    {r.case} ({r.run_id}): {laws_of(r) or r.status}; of their sizes: {sizes}")
    return sum(len(those) for _, those in found)


def main() -> int:
    """Ask all folders that are named."""
    parser = argparse.ArgumentParser("python -m mbsbench.tests.exam.misleading", description="Contradictory records.")
    parser.add_argument("results", nargs="+", type=Path, help="results folders")
    try:
        return int(sum(map(print_table, parser.parse_args().results)) > 0)
    except FileError as error:
        parser.error(str(error))


if __name__ == "__main__":
    sys.exit(main())
