"""Write the RO-Crate 1.1 metadata of a bundle: what its files are, what made them, when."""

from collections.abc import Mapping, Sequence
from typing import Any

from ...results.records import RunRecord

METADATA = "ro-crate-metadata.json"
SPECIFICATION = "https://w3id.org/ro/crate/1.1"
LICENSE = "https://spdx.org/licenses/MIT"
SOFTWARE = "#mbsbench"
TYPES = {".json": "application/json", ".npy": "application/octet-stream", ".toml": "application/toml"}
MEANING = {
    "bundle.json": "format and version of this bundle",
    "records.json": "one record a run",
    "table.json": "counts, least errors and costs by problem and solver",
    "runs.json": "problem and arrays of each run",
    "environment": "packages and machine of runs",
    "runs/": "states of a run",
    "series/": "series of a run",
    "problems/": "every number of a problem",
    "references/": "exact states of a problem",
}


def describe_crate(
    files: Mapping[str, tuple[str, int]], records: Sequence[RunRecord], *, lossless: bool
) -> dict[str, Any]:
    """Return the RO-Crate metadata of a bundle's ``files``: name, (SHA-256, size in bytes).

    Title, commits and date are those of ``records``; the date is that of the last run.
    """
    suites, ended = sorted({r.suite for r in records}), max((r.finished for r in records), default="")
    kept = "the states of every step" if lossless else "the states that decide on its status"
    root = {
        "@id": "./",
        "@type": "Dataset",
        "name": f"mbsbench results: {', '.join(filter(None, suites)) or 'runs'}",
        "description": f"{len(records)} runs of multibody solvers: for each its record and {kept}",
        "datePublished": ended[:10],
        "license": {"@id": LICENSE},
        "hasPart": [{"@id": name} for name in sorted(files)],
        "mentions": {"@id": "#runs"},
    }
    about = {"@id": METADATA, "@type": "CreativeWork", "conformsTo": {"@id": SPECIFICATION}, "about": {"@id": "./"}}
    commits = ", ".join(sorted({r.commit for r in records if r.commit}))
    software = {"@id": SOFTWARE, "@type": "SoftwareApplication", "name": "mbsbench", "softwareVersion": commits}
    made = {
        "@id": "#runs",
        "@type": "CreateAction",
        "name": "the runs",
        "instrument": {"@id": SOFTWARE},
        "endTime": ended,
        "result": [{"@id": "./"}],
    }
    entities = [
        {
            "@id": name,
            "@type": "File",
            "name": _describe_file(name),
            "contentSize": str(size),
            "sha256": digest,
            "encodingFormat": TYPES[name[name.rindex(".") :]],
        }
        for name, (digest, size) in sorted(files.items())
    ]
    licence = {"@id": LICENSE, "@type": "CreativeWork", "name": "MIT License"}
    terms = {"sha256": "https://schema.org/sha256"}
    return {
        "@context": [f"{SPECIFICATION}/context", terms],
        "@graph": [about, root, software, made, licence, *entities],
    }


def _describe_file(name: str) -> str:
    """Return what a file of a bundle is, by its name or its folder; any other is a suite."""
    return next((words for start, words in MEANING.items() if name.startswith(start)), "a suite")
