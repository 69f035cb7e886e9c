"""Describe the origin of runs that are made here: machine, packages, and the code that shapes their numbers.

``python -m mbsbench.harness.run.origin`` prints it as in processes of runs, for a process that loaded NumPy otherwise.
"""

import json
import sys
from typing import Any

from ..catalogue.codes import digest_code
from ..results import environment


def describe_environment(folder: str, suite: str, jobs: int, plugins: tuple[str, ...]) -> dict[str, Any]:
    """Return the content of ``environment.json``, the stamp of a results folder, for the present code.

    ``folder`` and ``suite`` are names, ``jobs`` is the number of runs in parallel.
    """
    return environment.describe_environment(folder, suite, jobs, plugins, digest_code(tuple(plugins)))


if __name__ == "__main__":
    sys.stdout.write(json.dumps(describe_environment("", "", 1, ())))
