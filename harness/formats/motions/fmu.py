"""Run a co-simulation FMU (FMI 2 or 3) at fixed communication steps by fmpy; its outputs are the columns of a table.

Its code is native and runs in a separate process. Indices of array elements in Modelica's spelling become a suffix:
``body2.r[1]`` is the column ``body2.r_1``.
"""

import dataclasses
import hashlib
import importlib
import importlib.util
import json
import re
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from ...base.confined_paths import read_whole
from ...base.files import FileError
from ...base.forked_process import ForkedProcess
from .tables import Table, read_table

SUFFIX = ".fmu"
LIMIT, MEMORY = 600.0, 4000.0  # [s] of CPU time and [MB] of a run
REAL = ("Real", "Float64", "Float32")  # types of variables that can be outputs


def run_fmu(path: Path, t_end: float, dt: float | None, step: float, wanted: Iterable[str]) -> Table:
    """Run an FMU from 0 to ``t_end`` [s], and return its outputs and the variables ``wanted`` as a table.

    Communication steps are ``dt`` or, if that is None, those that the FMU declares, else ``step`` [s]. Raise FileError
    if it cannot be run, or exceeds ``LIMIT`` or ``MEMORY``.
    """
    if importlib.util.find_spec("fmpy") is None:
        raise FileError(f"{path}: fmpy runs FMUs and is not installed: pip install 'mbsbench[formats]'")
    if not path.is_file():
        raise FileError(f"cannot read {path}: there is no such file")
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "motion.npz"

        def run(send: Callable[[str], None]) -> None:
            """Run the FMU in the other process, and send the error message as JSON, empty without an error."""
            try:
                _simulate(path, t_end, dt, step, frozenset(wanted), out)
                complaint = ""
            except Exception as error:  # fmpy and the FMU may raise anything: reported in one line
                complaint = " ".join(str(error).split()) or type(error).__name__
            send(json.dumps(complaint))

        ended = ForkedProcess(run, limit=LIMIT, memory=MEMORY).wait()
        if complaint := json.loads(ended.sent) if ended.sent else f"its process {ended.words}":
            raise FileError(f"{path}: {complaint}")
        digest = hashlib.sha256(read_whole(path)).hexdigest()
        return dataclasses.replace(read_table(out), path=path, sha256=digest)


def _simulate(path: Path, t_end: float, dt: float | None, step: float, wanted: frozenset[str], out: Path) -> None:
    """Run an FMU and write its outputs and the variables ``wanted``, by name, to the NPZ file ``out``.

    Steps are as in ``run_fmu``. Raise ValueError if it has no co-simulation or no outputs.
    """
    fmpy: Any = importlib.import_module("fmpy")
    model = fmpy.read_model_description(str(path))
    if model.coSimulation is None:
        raise ValueError("it has no co-simulation: export it as FMI 2 or 3 for Co-Simulation")
    declared = model.defaultExperiment.stepSize if model.defaultExperiment else None
    interval = dt or float(declared or 0.0) or step
    names = [v.name for v in model.modelVariables if v.type in REAL and (v.causality == "output" or v.name in wanted)]
    if not names:
        raise ValueError(f"it has no outputs of type {' or '.join(REAL)}")
    rows = fmpy.simulate_fmu(
        str(path), fmi_type="CoSimulation", start_time=0.0, stop_time=t_end, output_interval=interval, output=names
    )
    np.savez(out, **{k if k in wanted else _flatten_indices(k): rows[k] for k in rows.dtype.names})


def _flatten_indices(name: str) -> str:
    """Return a variable's name with indices in brackets as a suffix: ``body2.r[1]`` is ``body2.r_1``."""
    return re.sub(r"\[([\d, ]+)\]", lambda found: "_" + re.sub(r"\D", "", found[1]), name)
