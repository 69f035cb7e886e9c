"""Mutated results folders, with right digests or as they are: commands read, name or set aside, and go on."""

import hashlib
import json
import shutil

import numpy as np
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.results import store
from mbsbench.harness.results.npz import read_npz, write_npz
from mbsbench.tests.factories import PLUGIN

from .fuzzing import COUNT, Tally, mutate, mutate_json

SUITE = f"""name = "fuzzed"
plugins = ["{PLUGIN}"]
[[runs]]
problem = "heavy_top"
parameters = {{ t_end = 0.1 }}
solver = "gc_weak_form"
dt = [0.001, 0.002]
[[runs]]
problem = "free_fall"
solver = ["exact", "raises", "gives_up", "refuses"]
"""
QUICK = (
    ("show", "{0}"),
    ("show", "{0}", "--json"),
    ("bundle", "{0}", "-o", "{1}"),
    ("history", "{0}"),
    ("diff", "{0}", "{2}"),
    ("merge", "{1}.d", "{0}", "{2}"),
)
READERS = (*QUICK, *QUICK, ("report", "{0}"), *QUICK, ("figures", "{0}"))  # these take seconds


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("fuzzed")
    (place / "suite.toml").write_text(SUITE)
    main(["run", str(place / "suite.toml"), "--out", str(place / "run"), "--jobs", "1"])
    return place / "run"


def change(folder, random):
    """One file of the folder: its bytes; or a value of a record or an array, with the digests that belong to it."""
    records = sorted(folder.glob("runs/*.json"))
    path = records[random.integers(len(records))]
    way = random.random()
    if way < 0.4:
        record = json.loads(json.loads(path.read_text())["record"])
        return rewrite(path, mutate_json(record, random))
    with_series = [p for p in records if json.loads(json.loads(p.read_text())["record"])["series"]]
    if way < 0.75:
        path = with_series[random.integers(len(with_series))]
        record = json.loads(json.loads(path.read_text())["record"])
        series = folder / record["series"]
        arrays = dict(read_npz(series, 2**30))
        name = sorted(arrays)[random.integers(len(arrays))]
        arrays |= {name: change_array(arrays[name], random)}
        write_npz(series, arrays)
        record["series_sha256"] = hashlib.sha256(series.read_bytes()).hexdigest()
        return rewrite(path, record)
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    path = files[random.integers(len(files))]
    path.write_bytes(mutate(path.read_bytes(), random))
    return f"{path.name}, bytes"


def rewrite(path, record):
    """Write a record with the digest that belongs to it."""
    body = json.dumps(record)
    path.write_text(json.dumps({"sha256": store._digest(body), "record": body}))
    return f"{path.name}, values"


def change_array(a, random):
    """Make it another array: of other values, type, shape or order."""
    if a.dtype.kind not in "fi" or a.size == 0:
        return (np.array("{"), np.zeros(0), np.array("[" * 200))[random.integers(3)]
    b = a.astype(float).copy()
    where = tuple(int(random.integers(n)) for n in b.shape)
    ways = (
        lambda: b.astype("U16"),
        lambda: b.ravel()[:0],
        lambda: np.flip(b),
        lambda: b.astype(np.float16),
        lambda: b * 0.0,
        lambda: b.astype(complex),
        lambda: np.concatenate([b.ravel(), b.ravel()]),
        lambda: np.array(1.0),
        lambda: put(b, where, random.choice([np.nan, np.inf, -np.inf, 5e-324, -1e308, 1e308])),
    )
    return ways[random.integers(len(ways))]()


def put(b, where, value):
    b[where] = value
    return b


@pytest.mark.sampled(0)
def test_mutated_results_are_read_named_or_set_aside(folder, tmp_path):
    """No traceback, whatever command reads them."""
    tally, copy = Tally("results folders"), tmp_path / "copy"
    for command in ("show", "report", "figures"):  # as it is; and what readers import late is there for all
        assert main([command, str(folder)]) == 0
    for seed in range(COUNT):
        random = np.random.default_rng([seed, 7])
        shutil.rmtree(copy, ignore_errors=True)
        shutil.rmtree(tmp_path / "out.d", ignore_errors=True)
        shutil.copytree(folder, copy)
        what = change(copy, random)
        line = [word.format(copy, tmp_path / "out", folder) for word in READERS[seed % len(READERS)]]
        tally.run(f"seed {seed}, {what}, {line[0]}", lambda line=line: main(line))
    tally.close()
