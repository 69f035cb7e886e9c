"""Mutated tables of motions for ``referee``: text, NPZ, MAT and Parquet; judged, or refused in a line."""

import numpy as np
import pytest
from scipy.io import savemat

from mbsbench.cli.__main__ import main

from ..harness.formats.motions.test_referee import HEADER, exact
from .fuzzing import COUNT, Tally, mutate

KINDS = ("csv", "npz", "mat", "parquet")


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    """The exact motion of the heavy top in each format."""
    import pandas as pd

    place, rows = tmp_path_factory.mktemp("tables"), exact(5)
    columns = dict(zip(HEADER.split(","), rows.T, strict=True))
    frame = pd.DataFrame(columns)
    frame.to_csv(place / "top.csv", index=False)
    frame.to_parquet(place / "top.parquet")
    np.savez_compressed(place / "top.npz", **columns)
    savemat(place / "top.mat", columns, do_compression=True)
    return {kind: (place / f"top.{kind}").read_bytes() for kind in KINDS}


def test_mutated_tables_are_judged_or_refused(tables, tmp_path):
    """Exit code 0 to 3."""
    tally = Tally("tables")
    for kind in KINDS:  # as they are; and what readers import late is there for all
        path = tmp_path / f"top.{kind}"
        path.write_bytes(tables[kind])
        assert main(["referee", "heavy_top", str(path), "--t-end", "0.5"]) == 0
    for seed in range(COUNT):
        random, kind = np.random.default_rng([seed, 11]), KINDS[seed % len(KINDS)]
        path = tmp_path / f"top.{kind}"
        path.write_bytes(mutate(tables[kind], random, numbers=0.6 if kind == "csv" else 0.0))
        line = ["referee", "heavy_top", str(path), "--t-end", "0.5"]
        tally.run(f"seed {seed}, {kind}", lambda line=line: main(line))
    tally.close()
    assert set(tally.codes) <= {0, 1, 2, 3}
