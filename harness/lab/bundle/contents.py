"""List the files of a bundle from a results folder and the invariants of its problems, without running a solver."""

import contextlib
import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from ...base.confined_paths import ConfinedPath
from ...base.files import FileError, encode_nonfinite, parse_json, read_text
from ...mechanics.joints import KINDS
from ...mechanics.types import Status
from ...results import store
from ...results.records import COLUMNS, RunRecord, is_literal
from ...results.selection import REACTIONS, STATE, select_states
from ...results.series import Series
from .crate import METADATA, describe_crate
from .invariants import describe_invariants
from .table import make_table

FORMAT, VERSION = "mbsbench bundle", 5
RUN_ID = re.compile(r"[0-9a-f]{8,64}")
TEXT = re.compile(r"[a-z0-9_-]+\.toml|environment\.[0-9a-f]{12}\.json")  # of a results folder
LOCAL = ("executable", "results_folder")  # of an environment: names of this machine
DRAWN = (
    "frame_",
    "exact_",
    "state_",
    "sample_",
    "end_",
    "start_",
    "joint_",
    "system_",
    "last_",
    "bundled_",
)  # these series are no rows along t
SORT = "system_joint_sort"
ENERGY = "energy_error"  # of each state: the work done does not follow from the state
NUMBERS = ("gravity", "joint_i", "system_mass", "system_user_i", SORT, *(f"start_{name}" for name in STATE))
Array = np.ndarray[Any, Any]
NOTHING: Mapping[str, Series] = MappingProxyType({})
FORCES = {  # listed after the joints, as joints of one row: names of their numbers
    "spring": {"i": "i", "j": "j", "s_i": "p_i", "s_j": "p_j", "length": "d0", "k": "k", "c": "c"},
    "torsion": {"i": "i", "j": "j", "u": "u", "n": "n", "length": "rest", "k": "k", "c": "c"},
    "load": {"i": "i", "s_i": "p", "u": "force", "w": "torque", "length": "follows", "motion": "factor"},
}


@dataclass
class _ExactStates:
    """Exact states of a problem at the times of all its runs, each time once."""

    problem_numbers: dict[str, Any]  # every number of the problem
    at: dict[float, dict[str, Array]] = field(default_factory=dict)  # by time [s]: r, R, v, Omega, stated error

    def add(self, series: Series, chosen: Array) -> None:
        """Add the exact states at the samples of a run's series that ``chosen`` marks, except at known times."""
        for k in np.flatnonzero(chosen):
            state = {name: series[f"sample_{name}"][k] for name in (*STATE, "error")}
            self.at.setdefault(float(series["sample_t"][k]), state)

    def encode_matrix(self) -> bytes:
        """Return all states in order of time, with the reference's stated error [m], as the bytes of an NPY matrix."""
        times = sorted(self.at)
        stated, *states = (np.array([self.at[t][name] for t in times]) for name in ("error", *STATE))
        return _encode_states(stated, np.array(times), *states)


def list_contents(
    folder: Path, records: Iterable[RunRecord], *, lossless: bool, again: Mapping[str, Series] = NOTHING
) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of each file of the bundle except the manifest, in order.

    ``lossless`` bundles have the states of every step of every run, others those that decide on its status. ``again``
    has the series of runs that were solved again, by run_id; the others are read from ``folder``.
    """
    records, files = sorted(records, key=lambda r: r.run_id), dict[str, tuple[str, int]]()
    for name, content in _list_data(folder, records, again, lossless=lossless):
        files[name] = hashlib.sha256(content).hexdigest(), len(content)
        yield name, content
    yield METADATA, _encode_json(describe_crate(files, records, lossless=lossless))


def _list_data(
    folder: Path, records: Sequence[RunRecord], again: Mapping[str, Series], *, lossless: bool
) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of each file but the metadata; ``again`` and ``lossless`` as in ``list_contents``.

    Raise FileError where the id of a run is invalid, or its series damaged or too short for a lossless bundle.
    """
    runs, exact_of = list[dict[str, Any]](), dict[str, _ExactStates]()
    codes = sorted({r.code for r in records})
    yield "bundle.json", _encode_json({"format": FORMAT, "version": VERSION, "lossless": lossless, "codes": codes})
    yield from _list_texts(folder)
    encoded = [{c.name: encode_nonfinite(getattr(r, c.name)) for c in COLUMNS} for r in records]
    yield "records.json", _encode_json(encoded)
    yield "table.json", _encode_json(make_table(records))
    for record in records:
        if not RUN_ID.fullmatch(record.run_id):
            raise FileError(f"{record.run_id!r} is no id of a run")
        run: dict[str, Any] = {"run_id": record.run_id, "problem": "", "states": "none", "peaks_s": {}, "arrays": {}}
        run |= {"reactions": dict[str, list[float]](), "between": False}
        with _name_damaged_run(record):
            series = again.get(record.run_id) or store.read_run_series(folder, record)
            if series is not None and "state_t" in series:
                _check_arrays(record, series)
                problem = _describe_problem(record, series)
                run["problem"] = name = hashlib.sha256(_encode_json(problem)).hexdigest()[:16]
                chosen, exact_ones, run["between"] = select_states(series)
                chosen = chosen | lossless
                if lossless and len(chosen) <= record.steps and record.claimed == Status.SUCCESS:
                    kept = f"{len(chosen)} of its {record.steps + 1} states"
                    raise FileError(
                        f"run {record.run_id} keeps {kept}: run its suite with --lossless, or bundle without"
                    )
                exact_of.setdefault(name, _ExactStates(problem)).add(series, exact_ones | lossless)
                run["peaks_s"] = dict(series.peaks)
                for column in REACTIONS if "state_reaction" in series else ():
                    if column in series.peaks:
                        (at,) = np.flatnonzero(series["state_t"] == series.peaks[column])
                        run["reactions"][column] = series["state_reaction"][at].tolist()
                if np.any(chosen):
                    every = np.all(chosen) and len(chosen) == len(series["t"])
                    run["states"] = "every step" if every else "some steps"
                    states = (series[f"state_{key}"][chosen] for key in ("t", *STATE))
                    yield f"runs/{record.run_id}.npy", _encode_states(_select_energy_errors(series)[chosen], *states)
                if lossless:
                    run["arrays"], content = _pack_arrays(_select_rows(series))
                    yield f"series/{record.run_id}.npy", content
        runs.append(run)
    yield "runs.json", _encode_json(runs)
    for name, known in sorted(exact_of.items()):
        if known.at:
            yield f"references/{name}.npy", known.encode_matrix()
        yield f"problems/{name}.json", _encode_json(known.problem_numbers)


@contextlib.contextmanager
def _name_damaged_run(record: RunRecord) -> Iterator[None]:
    """Convert errors in the block, such as malformed arrays of a series cause, to a FileError that names the run."""
    try:
        yield
    except FileError:
        raise
    except (ValueError, TypeError, IndexError, KeyError, OverflowError):
        raise FileError(f"the series of run {record.run_id} are not whole: run it again") from None


def _check_arrays(record: RunRecord, series: Series) -> None:
    """Raise FileError unless all numbers of the problem are present and finite, and states have the right shapes.

    Raise it, too, where a torsional spring turns beyond half a turn about rest.
    """
    if "end_turns" in series and np.any(series["end_turns"]):
        raise FileError(
            f"run {record.run_id}: its torsional springs turn beyond half a turn about rest, which "
            "states do not record; leave it out"
        )
    nb = len(series["system_mass"]) if "system_mass" in series else -1
    shape = {"t": (), "r": (nb, 3), "R": (nb, 3, 3), "v": (nb, 3), "Omega": (nb, 3), "error": ()}
    whole = all(name in series for name in (*NUMBERS, "t", ENERGY)) and bool(
        np.all(np.isin(series[SORT], np.arange(len(KINDS))))
    )
    for kind, names in (("state", tuple(shape)[:-1]), ("sample", tuple(shape))):
        if f"{kind}_t" in series:
            found = (series.arrays.get(f"{kind}_{name}", np.zeros((0, 0))) for name in names)
            whole &= all(a.shape[1:] == shape[n] and a.dtype == float for n, a in zip(names, found, strict=True))
    if not whole or any(not np.all(np.isfinite(series[name])) for name in NUMBERS):
        raise FileError(f"the series of run {record.run_id} are not whole: run it again")


def _select_energy_errors(series: Series) -> Array:
    """Return the energy error [J] of each state: its own, or that of the row of the series at the same time."""
    if f"state_{ENERGY}" in series:
        return series[f"state_{ENERGY}"]
    return series[ENERGY][np.searchsorted(series["t"], series["state_t"])]


def _select_rows(series: Series) -> dict[str, Array]:
    """Return the arrays with one number for each time ``t``, and the reactions of the states if there are any."""
    rows = {name: a for name, a in series.arrays.items() if not name.startswith(DRAWN) and a.shape == series["t"].shape}
    return rows | {name: a for name, a in series.arrays.items() if name == "state_reaction"}


def _describe_problem(record: RunRecord, series: Series) -> dict[str, Any]:
    """Return every number of the problem of a run, from its series, with its invariants and its reference in words."""
    plain = {"gravity": series["gravity"], **{k: a for k, a in series.arrays.items() if k.startswith("joint_")}}
    plain |= {k.removeprefix("system_"): a for k, a in series.arrays.items() if k.startswith("system_")}
    plain |= {k: a for k, a in series.arrays.items() if k.startswith("start_")}
    kinds = [str(KINDS[k]) for k in plain.pop("joint_sort")]
    kinds += [force for force in FORCES for _ in plain[f"{force}_i"]]
    plain = _add_forces(plain)
    return {
        "problem": record.problem,
        "parameters": dict(record.parameters),
        "t_end_s": record.t_end_s,
        "literal_start": is_literal(record),
        "section": record.section,
        "body_names": series.body_names,
        "joint_names": series.joint_names,
        "joint_kinds": kinds,
        "not_serialised": [f"user force {k}" for k in range(len(plain["user_i"]))],
        "invariants": describe_invariants(record.problem, record.problem_parameters),
        "reference": {
            "kind": series.reference,
            "route": record.reference,
            "horizon_s": encode_nonfinite(record.reference_horizon_s),
        },
        "numbers": {name: a.tolist() for name, a in sorted(plain.items())},
    }


def _add_forces(plain: Mapping[str, Array]) -> dict[str, Array]:
    """Return the numbers of a problem, with its springs, torsional springs and loads appended to its joints.

    A reader of the bundle then has one table of connections, in which ``FORCES`` names the columns that each kind
    fills; others are 0. A load has the ground as its second body.
    """
    own = {name: a for name, a in plain.items() if not name.startswith(tuple(f"{force}_" for force in FORCES))}
    own |= {f"joint_{key}": np.zeros(len(own["joint_i"])) for key in ("k", "c")}
    for force, names in FORCES.items():
        size = len(plain[f"{force}_i"])
        numbers = {key: plain[f"{force}_{name}"] for key, name in names.items()}
        numbers |= {"moving": np.ones(size)} | ({} if "j" in names else {"j": np.full(size, -1.0)})
        for name in [name for name in own if name.startswith("joint_")]:
            rows = np.zeros((size, *own[name].shape[1:]))
            given = numbers.get(name.removeprefix("joint_"), rows)
            rows[tuple(slice(n) for n in given.shape)] = given  # a torsional spring fills two normals of three
            own[name] = np.concatenate([own[name], rows])
    return own


def _encode_states(stated: Array, *states: Array) -> bytes:
    """Return the bytes of an NPY matrix of states, with time along its columns.

    Its rows are the times, each number of each body, and ``stated``: the stated error or the energy error. ``states``
    are t, r, R, v, Omega.
    """
    t, r, *_ = states
    bodies = np.concatenate([a.reshape(*r.shape[:2], -1) for a in states[1:]], axis=2)
    return _encode_npy(np.concatenate([t[None], bodies.reshape(len(t), -1).T, stated[None]]))


def _pack_arrays(arrays: Mapping[str, Array]) -> tuple[dict[str, Any], bytes]:
    """Return where each array begins in a vector of all, {name: [offset, shape]}, and that vector as NPY bytes."""
    index, offset = dict[str, Any](), 0
    for name, a in arrays.items():
        index[name] = [offset, list(a.shape)]
        offset += a.size
    return index, _encode_npy(np.concatenate([np.zeros(0), *(a.ravel() for a in arrays.values())]))


def _encode_npy(a: Array) -> bytes:
    """Return the bytes of an NPY file, which do not depend on the version of NumPy."""
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {a.shape}, }}"
    head += " " * (-(len(head) + 11) % 64) + "\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head.encode() + np.asarray(a, "<f8").tobytes()


def _list_texts(folder: Path) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of the suites in a results folder and of its environments.

    Entries of an environment that name this machine's folders (``LOCAL``) are left out.
    """
    here = ConfinedPath(folder)
    for name in filter(TEXT.fullmatch, here.names()):
        text = read_text(here / name, name)
        if name.startswith("environment."):
            plain = parse_json(text, name)
            text = json.dumps({k: v for k, v in plain.items() if k not in LOCAL}, indent=1, sort_keys=True)
        yield name, text.encode()


def _encode_json(value: Any) -> bytes:
    """Return a value as compact JSON, the same bytes on every machine; raise ValueError for NaN."""
    return json.dumps(value, sort_keys=True, allow_nan=False, separators=(",", ":")).encode()
