"""Mutated bundles, with a manifest that fits them or as they are: the checker and the ladder say what is wrong."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from mbsbench.harness.lab.ladder.bundling import read_entry

from .bundles import write
from .cases import checker
from .fuzzing import COUNT, Tally, mutate, mutate_json


def change(files: dict[str, bytes], random: np.random.Generator) -> dict[str, bytes]:
    """One member changed: its bytes, or a value of its JSON."""
    name = sorted(files)[random.integers(len(files))]
    if name.endswith(".json") and random.random() < 0.7:
        return files | {name: json.dumps(mutate_json(json.loads(files[name]), random)).encode()}
    if name.endswith(".npy") and random.random() < 0.5:
        values = np.frombuffer(files[name], "<f8", offset=128).copy()
        values[random.integers(len(values))] = random.choice([np.nan, np.inf, -1e308, 0.0, 1e-320, 1e9])
        return files | {name: files[name][:128] + values.tobytes()}
    return files | {name: mutate(files[name], random)}


@pytest.mark.sampled(0)
@pytest.mark.parametrize("reader", ["checker", "ladder"])
def test_mutated_bundles_end_in_words(bundles, tmp_path, reader):
    """Exit code 0, 1 or 2, nothing else."""
    tally, path = Tally(f"bundles, {reader}"), tmp_path / "b.zip"

    def check() -> int:
        return int(checker.main(path))

    def enter() -> int:
        return int(bool(read_entry(Path(path)).forged))

    least = COUNT if reader == "checker" else -(-COUNT // 10)  # the ladder starts the checker each time
    for seed in range(least):
        random = np.random.default_rng([seed, len(reader)])
        files = bundles[("thin", "lossless")[seed % 2]]
        write(path, change(files, random))
        if seed % 5 == 4:  # the archive itself
            path.write_bytes(mutate(path.read_bytes(), random))
        tally.run(f"seed {seed}", check if reader == "checker" else enter)
    tally.close(least)
    assert set(tally.codes) <= {0, 1, 2}
    assert zipfile.is_zipfile(write(path, bundles["thin"]))
