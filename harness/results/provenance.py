"""Find inputs in which two runs differ, as possible causes of different results."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..base.confined_paths import ConfinedPath
from ..base.files import FileError, parse_json, read_text
from . import environment
from .findings import Finding

WORDS = {  # compared keys of a stamp, in words
    "code": "code that shapes results",
    "lock_sha256": "lock file",
    "python": "Python",
    "implementation": "Python implementation",
    "cpu": "processor",
    "machine": "machine type",
    "system": "operating system",
    "blas": "linear algebra libraries and their kernels",
    "simd": "SIMD features of NumPy",
    "llvm": "processor that code is compiled for",
    "libc": "C library",
    "threads": "threads",
    "plugins": "plugins",
    "suite": "suite",
}


def read_environment(folder: Path, name: str = "environment.json") -> dict[str, Any]:
    """Return the stamp ``name`` of a results folder; empty if it is missing or invalid; raise UnsafeFile for a link."""
    path = ConfinedPath(folder) / name
    try:
        plain = parse_json(read_text(path, "environment"), str(path))
    except FileError:
        return {}
    return plain if isinstance(plain, dict) else {}


def find_differences(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[Finding]:
    """Return a finding on each input in which two stamps differ: required is the value before, words are that after.

    If a whole stamp is missing, that is the only finding. If the code differs, ``why`` names files that changed.
    """
    if not (before and after):
        there = ["there" if s else "missing" for s in (before, after)]
        return [Finding("environment.json", words=there[1], required=there[0])]
    out = []
    for key, words in WORDS.items():
        a, b = before.get(key), after.get(key)
        if environment.format_setting(a) != environment.format_setting(b):
            detail = _list_changed_files(before, after) if key == "code" else ""
            out.append(Finding(words, words=_format(b), required=_format(a), why=detail))
    a, b = (s.get("packages") if isinstance(s.get("packages"), dict) else {} for s in (before, after))
    assert isinstance(a, dict) and isinstance(b, dict)
    for name in sorted({*a, *b}):
        if a.get(name) != b.get(name):
            out.append(Finding(f"package {name}", words=_format(b.get(name)), required=_format(a.get(name))))
    return out


def is_same_platform(before: Mapping[str, Any], after: Mapping[str, Any]) -> bool:
    """Return whether, by two stamps, runs of equal code must agree bit for bit; False if ``before`` is empty."""
    return bool(before) and environment.digest_arithmetic(before) == environment.digest_arithmetic(after)


def describe_processor(stamp: Mapping[str, Any]) -> str:
    """Return the processor in a stamp as text, with the kernels of linear algebra in brackets if these are not pinned.

    Empty if the stamp does not name it.
    """
    blas = stamp.get("blas") if isinstance(stamp.get("blas"), list) else []
    assert isinstance(blas, list)
    kernels = sorted({str(b["architecture"]) for b in blas if isinstance(b, dict) and b.get("architecture")})
    own = "pinned" in stamp and not stamp["pinned"] and kernels
    words = f" ({', '.join(kernels)} kernels)" if own else ""
    return f"{stamp.get('cpu') or ''}{words}"


def describe_differences(found: Sequence[Finding]) -> str:
    """Describe the differences between two stamps in a sentence; without any, name what may differ nevertheless."""
    if not found:
        return "no input differs: a solver is not deterministic, or a limit on time or memory was reached"
    return "; ".join(f"{d.quantity} {d.required} -> {d.words}" + (f" ({d.why})" if d.why else "") for d in found)


def _list_changed_files(before: Mapping[str, Any], after: Mapping[str, Any]) -> str:
    """Return the names of up to five files that differ between the commits of two stamps; note uncommitted changes.

    Empty if nothing differs.
    """
    commits = [str(s.get("commit", "")) for s in (before, after)]
    note = "uncommitted changes" if before.get("dirty") or after.get("dirty") else ""
    if not all(commits) or commits[0] == commits[1]:
        return note
    changed = environment.list_changed_files(*commits)
    shown = ", ".join(changed[:5]) + (f" and {len(changed) - 5} more" if changed[5:] else "")
    return "; ".join(filter(None, (shown, note)))


def _format(value: Any) -> str:
    """Return the value of a stamp as text, ``none`` if it is empty."""
    if value in (None, "", []):
        return "none"
    return value if isinstance(value, str) else json.dumps(value)
