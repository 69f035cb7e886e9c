"""Answers questions about an engine's model: ``python -I serve.py FILE``, lines of JSON on stdin and stdout.

FILE has a class ``Model(data)`` with ``notes``, ``at_start()`` and ``advance(steps, dt)``, as module
``export.protocol`` says. Whatever an engine prints goes to standard error.
"""

import ctypes
import importlib.util
import json
import os
import resource
import signal
import sys

import numpy as np

PR_SET_PDEATHSIG = 1  # prctl(2)


def main(path: str) -> None:
    """Serve the model of ``path`` until the parent closes the pipe or dies."""
    parent = os.getppid()
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGKILL), 0, 0, 0)
    if os.getppid() != parent:
        return
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    spec = importlib.util.spec_from_file_location("engine", path)
    engine = importlib.util.module_from_spec(spec)
    model, stepping, models = None, 0.0, 0
    for line in sys.stdin.buffer:
        asked, answer, rows = json.loads(line), {}, b""
        try:
            if asked["do"] == "build":
                if not models:
                    spec.loader.exec_module(engine)
                model, models = engine.Model(asked["data"]), models + 1
                answer = {"model": models, "notes": list(model.notes)}
            elif asked["model"] != models:
                raise ValueError(f"model {asked['model']} was replaced by model {models}")
            elif asked["do"] == "at_start":
                answer = model.at_start()
            else:
                before = seconds()
                made = np.ascontiguousarray(model.advance(asked["steps"], asked["dt"]), dtype=np.float64)
                stepping += seconds() - before
                answer, rows = {"shape": made.shape, "stopped": model.stopped}, made.tobytes()
        except ValueError as error:
            answer = {"refusal": " ".join(str(error).split())}
        answer |= {"stepping": stepping, "cpu": seconds()}
        answers.write(json.dumps(answer, default=lambda a: a.tolist()).encode() + b"\n" + rows)
        answers.flush()


def seconds() -> float:
    """User and system time of all threads [s]."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main(sys.argv[1])
