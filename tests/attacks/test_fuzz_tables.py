"""Mutated tables of motions for ``referee``: text, NPZ, MAT and Parquet; judged, or refused in a line."""

import numpy as np
import pytest
from scipy.io import savemat

from mbsbench.cli.__main__ import main

from .fuzzing import COUNT, Tally, mutate

KINDS = ("csv", "npz", "mat", "parquet")


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    """A free fall in each format."""
    import pandas as pd

    place, t = tmp_path_factory.mktemp("tables"), np.linspace(0.0, 1.0, 41)
    columns = {
        "t": t,
        "x": 0 * t,
        "y": 0 * t,
        "z": -0.5 * 9.81 * t**2,
        "qw": 1 + 0 * t,
        "qx": 0 * t,
        "qy": 0 * t,
        "qz": 0 * t,
    }
    frame = pd.DataFrame(columns)
    frame.to_csv(place / "fall.csv", index=False)
    frame.to_parquet(place / "fall.parquet")
    np.savez_compressed(place / "fall.npz", **columns)
    savemat(place / "fall.mat", columns, do_compression=True)
    return {kind: (place / f"fall.{kind}").read_bytes() for kind in KINDS}


def test_mutated_tables_are_judged_or_refused(tables, tmp_path):
    """Exit code 0 to 3."""
    tally = Tally("tables")
    for kind in KINDS:  # as they are; and what readers import late is there for all
        (tmp_path / f"fall.{kind}").write_bytes(tables[kind])
        assert main(["referee", "torque_free_body", str(tmp_path / f"fall.{kind}"), "--t-end", "1"]) in (1, 3)
    for seed in range(COUNT):
        random, kind = np.random.default_rng([seed, 11]), KINDS[seed % 4]
        path = tmp_path / f"fall.{kind}"
        path.write_bytes(mutate(tables[kind], random, numbers=0.6 if kind == "csv" else 0.0))
        line = ["referee", "torque_free_body", str(path), "--t-end", "1"]
        tally.run(f"seed {seed}, {kind}", lambda line=line: main(line))
    tally.close()
    assert set(tally.codes) <= {0, 1, 2, 3}
