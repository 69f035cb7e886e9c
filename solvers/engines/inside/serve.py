"""Serve an engine's model to another process: requests are lines of JSON on stdin (``python -I serve.py FILE``).

FILE has a class ``Model(data)`` with ``notes``, ``describe_start()`` and ``advance(steps, dt)``, as module
``export.protocol`` says. Whatever an engine prints goes to standard error; answers go to standard output.
"""

import ctypes
import importlib
import json
import os
import resource
import signal
import sys
from pathlib import Path
from typing import Any

import numpy as np

PR_SET_PDEATHSIG = 1  # prctl(2)


def main(path: str) -> None:
    """Serve models of the engine's file ``path`` by requests on stdin, until the parent closes the pipe or dies.

    A new model replaces the last one. A ValueError is answered as a refusal.
    """
    parent = os.getppid()
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGKILL), 0, 0, 0)
    if os.getppid() != parent:
        return
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    make: Any = None
    model: Any = None
    stepping, models = 0.0, 0
    for line in sys.stdin.buffer:
        asked, rows = json.loads(line), b""
        answer: dict[str, Any]
        try:
            if asked["do"] == "build":
                make = make or load_model_class(path)
                model, models = make(asked["data"]), models + 1
                answer = {"model": models, "notes": list(model.notes)}
            elif asked["model"] != models:
                raise ValueError(f"model {asked['model']} was replaced by model {models}")
            elif asked["do"] == "at_start":
                answer = model.describe_start()
            else:
                made, spent = step(model, asked["steps"], asked["dt"])
                stepping += spent
                answer, rows = {"shape": made.shape, "stopped": model.stopped}, made.tobytes()
        except ValueError as error:
            answer = {"refusal": " ".join(str(error).split())}
        answer |= {"stepping": stepping, "cpu": read_cpu_time()}
        answers.write(json.dumps(answer, default=lambda a: a.tolist()).encode() + b"\n" + rows)
        answers.flush()


def load_model_class(path: str) -> Any:
    """Load the file ``path`` as a module of the package that its folder is, and return its class ``Model``."""
    file = Path(path)
    sys.path.append(str(file.parent.parent))  # last: files beside that folder have the names of packages
    return importlib.import_module(f"{file.parent.name}.{file.stem}").Model


def step(model: Any, steps: int, dt: float) -> tuple[np.ndarray, float]:
    """Advance ``model`` by ``steps`` steps of ``dt`` [s]; return its rows and the CPU time [s] of ``advance``."""
    before = read_cpu_time()
    made = model.advance(steps, dt)
    spent = read_cpu_time() - before
    made = getattr(model, "rows", np.asarray)(made)
    return np.ascontiguousarray(made, dtype=np.float64), spent


def read_cpu_time() -> float:
    """Return the user and system CPU time [s] of all threads of this process."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main(sys.argv[1])
