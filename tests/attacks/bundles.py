"""Bundles to attack: of short runs that have between them every kind of number, and each run of them by itself."""

import hashlib
import json
import zipfile

from mbsbench.cli.__main__ import main
from mbsbench.harness.lab.bundle.table import make_table
from mbsbench.harness.results import records
from mbsbench.tests.factories import PLUGIN

SUITE = f"""name = "attacked"
plugins = ["{PLUGIN}"]
[[runs]]
problem = "heavy_top"
parameters = {{ t_end = 0.1 }}
solver = "gc_weak_form"
dt = 0.001
[[runs]]
problem = "spherical_pendulum"
parameters = {{ t_end = 0.3, omega_z = 0.0 }}
solver = "rk45_strong_form"
rtol = 1e-8
[[runs]]
problem = "spherical_pendulum"
parameters = {{ t_end = 0.3, literal_start = true }}
solver = "gc_weak_form"
dt = 0.003
[[runs]]
problem = "heavy_top"
parameters = {{ t_end = 0.4 }}
solver = "gc_weak_form"
dt = 0.05
[[runs]]
problem = "damped_linkage"
parameters = {{ t_end = 0.1 }}
solver = "rk45_strong_form"
rtol = 1e-8
[[runs]]
problem = "driven_slider_crank"
parameters = {{ t_end = 0.1 }}
solver = "rk45_strong_form"
rtol = 1e-8
[[runs]]
problem = "pumped_pendulum"
parameters = {{ t_end = 0.1 }}
solver = "rk45_strong_form"
rtol = 1e-8
[[runs]]
problem = "free_fall"
solver = ["refuses", "raises", "gives_up"]
dt = 0.05
"""


def make_bundles(folder):
    """The files of a thinned and of a lossless bundle of the suite."""
    (folder / "suite.toml").write_text(SUITE)
    results = str(folder / "results")
    assert main(["run", str(folder / "suite.toml"), "--out", results, "--lossless", "--jobs", "1"]) in (0, 1)
    out = {}
    for name, options in (("thin", []), ("lossless", ["--lossless"])):
        path = folder / f"{name}.zip"
        assert main(["bundle", results, "-o", str(path), "--plugin", str(PLUGIN), *options]) == 0
        with zipfile.ZipFile(path) as archive:
            out[name] = {member: archive.read(member) for member in archive.namelist()}
    return out


def cut_run(files, where):
    """The files of a bundle with the one run left of which ``where`` is true, given its record."""
    (record,) = filter(where, json.loads(files["records.json"]))
    (run,) = (r for r in json.loads(files["runs.json"]) if r["run_id"] == record["run_id"])
    own, parts = (record["run_id"], run["problem"] or "none"), ("runs/", "series/", "problems/", "references/")
    kept = {n: raw for n, raw in files.items() if not n.startswith(parts) or any(key in n for key in own)}
    kept["bundle.json"] = json.dumps(json.loads(files["bundle.json"]) | {"codes": [record["code"]]}).encode()
    return kept | write_parts(record, run)


def write_parts(record, run):
    """Records, runs and the table of a bundle of one run."""
    try:
        table = make_table([records.parse_record_json(json.dumps(record))])
    except ValueError:  # no record any more: its table is that of what it was
        return {"records.json": json.dumps([record]).encode(), "runs.json": json.dumps([run]).encode()}
    parts = {"records": [record], "runs": [run], "table": table}
    return {f"{name}.json": json.dumps(part).encode() for name, part in parts.items()}


def write(path, files):
    """Write the files with a manifest that fits them."""
    files = {name: raw for name, raw in files.items() if name != "manifest-sha256.txt"}
    lines = [f"{hashlib.sha256(raw).hexdigest()}  {name}\n" for name, raw in files.items()]
    with zipfile.ZipFile(path, "w") as archive:
        for name, raw in (files | {"manifest-sha256.txt": "".join(lines).encode()}).items():
            archive.writestr(name, raw)
    return path
