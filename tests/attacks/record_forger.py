"""A solver that writes records of other runs into the results folder, then works on until its suite is stopped."""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from mbsbench import Problem, StepControl, Trajectory, solver

FORGED = "FORGED_RECORDS"  # environment: JSON, the content of each file by its path


@solver("forges_records")
@dataclass(frozen=True)
class ForgesRecords:
    """Writes, then works."""

    paper_label: ClassVar[str] = ""
    control: ClassVar[str] = "dt"

    def refuses(self, problem: Problem, control: StepControl) -> None:
        """Nothing."""

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Never returns."""
        for path, text in json.loads(os.environ[FORGED]).items():
            Path(path).write_text(text)
        while True:
            sum(range(100_000))  # CPU time without a pause: it is what the limit of the suite counts
