"""Reactions that are false but where the page says that they are looked at: steps that nobody knew find them."""

import json
from pathlib import Path

import numpy as np
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue.registry import load_plugin
from mbsbench.harness.results import store
from mbsbench.tests.factories import specify_run, store_run

from .test_check_bundle import checker, read, write
from .test_forged_motions import PARAMETERS, of_vector

JUMPS = "whose reactions jump from step to step, which hides false ones"


def make_bundle(place, dt):
    """The files of a lossless bundle of an honest pendulum."""
    load_plugin(Path(__file__).parent / "forged.py")
    folder = store.create_folder(place / "results")
    store_run(folder, specify_run("spherical_pendulum", "forged", PARAMETERS, dt=dt))
    assert main(["bundle", str(folder), "-o", str(place / "b.zip"), "--lossless"]) == 0
    return read(place / "b.zip")


def forge(files, dt):
    """The files with threefold reactions at all steps but those of truncation, their neighbours and the instants."""
    (run,) = json.loads(files["runs.json"])
    files = dict(files)

    def treble(rows):
        known = np.unique(np.linspace(1, len(rows) - 2, 100).round().astype(int))
        kept = np.concatenate([known - 1, known, known + 1])
        at = [round(run["peaks_s"][column] / dt) for column in run["reactions"]]
        false = np.setdiff1d(np.arange(len(rows)), [*kept, *at])
        assert len(false) > 0.3 * len(rows)
        rows = rows.copy()
        rows[false] *= 3.0
        return rows

    of_vector(files, run, treble)
    return files


def report(tmp_path, files):
    with np.errstate(all="ignore"):
        return checker.Report(write(tmp_path / "b.zip", files))


@pytest.mark.parametrize(("dt", "is_found"), [(2.5e-4, True), (1e-3, False)], ids=["long", "short"])
def test_reactions_that_are_false_beside_the_known_steps_are_seen(tmp_path, dt, is_found):
    """Between known steps far apart they are found; where every third step is known they jump, which is said."""
    honest = make_bundle(tmp_path, dt)
    right = report(tmp_path, honest)
    assert right.findings == [] and JUMPS not in right.weak
    seen = report(tmp_path, forge(honest, dt))
    assert {line[18:56].strip() for line in seen.findings} == ({"truncation at drawn steps"} if is_found else set())
    assert JUMPS in seen.weak
