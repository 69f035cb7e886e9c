"""Pin the settings of this machine that determine the bits of a run, before NumPy loads, and describe those in force.

Three libraries choose instructions by the processor: OpenBLAS its kernels, NumPy its loops, LLVM (numba, and our own
code) its target. Each reads the environment once, when it loads. ``pin_arithmetic`` sets all three to what every
processor with AVX2 has, so that all of them round alike; preset values are overridden. ``MBSBENCH_NATIVE=1``, or
``--native`` of a command, turns it off; ``MBSBENCH_CORE`` only chooses other kernels of OpenBLAS.
docs/decisions/same-bits.md has the reasons and the measurements.
"""

import contextlib
import hashlib
import importlib.metadata
import importlib.util
import os
import platform
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from .cache import ROOT, make_cache_folder, read_cached_file

LARGEST = 2**16  # [bytes] of the file with NumPy's names
NATIVE = "MBSBENCH_NATIVE"
CORE = "MBSBENCH_CORE"  # keeps the pin but takes the kernels of this OpenBLAS core type: only BLAS rounds differently
ENABLED = "NPY_ENABLE_CPU_FEATURES"  # NumPy refuses to load if this is set beside disabled features
THREADS = dict.fromkeys(
    (  # one thread: timings are CPU time of one core, and results do not depend on the number
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "BLIS_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
        "NUMEXPR_NUM_THREADS",
        "NUMBA_NUM_THREADS",
    ),
    "1",
)


class Target(NamedTuple):
    """A reference processor: all processors of its architecture are restricted to its features, for equal bits."""

    kernels: str  # OpenBLAS's name of a core type
    compiled: str  # LLVM's name of a processor, which implies its features
    needs: frozenset[str]  # flags of /proc/cpuinfo that the code needs; abm: lzcnt
    loops: frozenset[str]  # NumPy's names of the features that its loops may use


TARGETS = {
    "x86_64": Target(
        "Haswell",
        "haswell",
        frozenset(("avx2", "fma", "bmi1", "bmi2", "movbe", "abm", "f16c")),
        frozenset(
            (
                "SSE",
                "SSE2",
                "SSE3",
                "SSSE3",
                "SSE41",
                "SSE42",
                "POPCNT",
                "AVX",
                "F16C",
                "FMA3",
                "AVX2",
                "X86_V2",
                "X86_V3",
            )
        ),
    ),
    "aarch64": Target(
        "ARMV8", "generic", frozenset(("asimd",)), frozenset(("NEON", "NEON_FP16", "NEON_VFPV4", "ASIMD"))
    ),
}
ASK = "import numpy; s = numpy.show_config('dicts')['SIMD Extensions']; print(*s['found'], *s.get('not found', ()))"
NAMES = re.compile(r"[A-Z0-9_ ]*")
_before: dict[str, str | None] = {}  # values that ``pin_arithmetic`` found preset, for ``unpin_arithmetic``


def pin_arithmetic() -> None:
    """Set the environment of this process and its children so that runs have the same bits everywhere.

    Libraries that are loaded already do not change: ``find_deviations`` names them. Do nothing if
    ``MBSBENCH_NATIVE`` is 1.
    """
    if os.environ.get(NATIVE) == "1":
        return
    for name, value in list_variables().items():
        if name.startswith("NUMBA_") and "numba" in sys.modules:
            continue  # it compiles as before, but would store that code under the names of these
        _before.setdefault(name, os.environ.get(name))
        os.environ[name] = value
    if list_variables():
        _before.setdefault(ENABLED, os.environ.pop(ENABLED, None))


def unpin_arithmetic() -> None:
    """Turn pinned arithmetic off and restore the environment that it replaced, also for children.

    Call it before NumPy loads.
    """
    os.environ[NATIVE] = "1"
    for name, value in _before.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
    _before.clear()


@cache
def list_variables() -> dict[str, str]:
    """Return the environment variables that pin the arithmetic, by name; empty if no target suits this processor."""
    target = _find_target()
    if target is None:
        return {}
    return {
        "OPENBLAS_CORETYPE": os.environ.get(CORE) or target.kernels,
        "NPY_DISABLE_CPU_FEATURES": " ".join(_list_unwanted_features(target)),
        "NUMBA_CPU_NAME": target.compiled,
        "NUMBA_CPU_FEATURES": "",
    }


def find_llvm_target() -> tuple[str, str]:
    """Return LLVM's name and features of the processor that our code is compiled for: the pinned one, or this."""
    if os.environ.get(NATIVE) != "1" and (target := _find_target()) is not None:
        return target.compiled, ""
    return _find_host()


def find_numba_target() -> tuple[str, str]:
    """Return name and features of the processor that numba compiles for, or will when loaded."""
    config = sys.modules.get("numba.core.config")
    name = config.CPU_NAME if config else os.environ.get("NUMBA_CPU_NAME")
    features = config.CPU_FEATURES if config else os.environ.get("NUMBA_CPU_FEATURES")
    return name or _find_host()[0], _find_host()[1] if features is None else features


@cache
def _find_host() -> tuple[str, str]:
    """Return LLVM's name of this processor, and its features."""
    import llvmlite.binding as llvm

    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def find_deviations() -> list[str]:
    """Describe in a few words each the libraries of this process that deviate from pinned arithmetic; import NumPy."""
    target = _find_target()
    if target is None:
        return [f"this processor ({platform.machine()}, {platform.system()}) has no pinned arithmetic"]
    loops = sorted(set(list_features()) - target.loops)
    kernels = sorted({k for k in list_kernels() if k and k.lower() != target.kernels.lower()})
    cpu, pinned = find_llvm_target()[0], (target.compiled, "")
    tunables = os.environ.get("GLIBC_TUNABLES", "")  # read before any of our code runs: it cannot be pinned
    return [
        *([f"NumPy uses {', '.join(loops)}"] if loops else []),
        *([f"OpenBLAS uses kernels of {', '.join(kernels)}"] if kernels else []),
        *([f"LLVM compiles for {cpu}"] if cpu != target.compiled else []),
        *([f"numba compiles for {find_numba_target()[0]}"] if find_numba_target() != pinned else []),
        *(["GLIBC_TUNABLES chooses functions of the C library"] if "glibc.cpu.hwcaps" in tunables else []),
    ]


@cache
def name_arithmetic() -> str:
    """Return a digest of how this process deviates from pinned arithmetic, as a key of caches; empty if it does not."""
    found = find_deviations()
    return _digest("; ".join(found)) if found else ""


def explain_deviations() -> str:
    """Return one line on why results deviate from pinned arithmetic; empty if they do not or the user turned it off."""
    found = [] if os.environ.get(NATIVE) == "1" else find_deviations()
    words = "these runs have the bits of this processor, not those that runs have everywhere"
    return f"{words} ({'; '.join(found)})" if found else ""


def list_kernels() -> list[str]:
    """List the core types whose kernels the loaded BLAS libraries use, as ``threadpoolctl`` names them."""
    from threadpoolctl import threadpool_info

    return [str(b.get("architecture") or "") for b in threadpool_info() if b.get("user_api") == "blas"]


def list_features() -> list[str]:
    """List the SIMD features in force in NumPy, of those that it chooses from at run time."""
    import numpy

    return list(numpy.show_config(mode="dicts")["SIMD Extensions"]["found"])


def describe_machine() -> dict[str, Any]:
    """Return what determines bits and times on this machine, as in ``environment.json``.

    ``pinned``; NumPy's SIMD features, LLVM's processor, libc; the clock governor, turbo, and the load of the last
    minute [1]. Facts that the system does not provide are empty.
    """
    governor = _read_system_file("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor").strip()
    libc = " ".join(platform.libc_ver()).strip() or platform.system()
    return {
        "pinned": not find_deviations(),
        "simd": list_features(),
        "llvm": _describe_compilers(),
        "libc": libc,
        "governor": governor,
        "turbo": _read_turbo(),
        "load": round(os.getloadavg()[0], 2),
    }


def _describe_compilers() -> str:
    """Return the processor that our code is compiled for, as LLVM names it, and that of numba if it differs."""
    ours, numba = (" ".join(filter(None, target)) for target in (find_llvm_target(), find_numba_target()))
    return ours if numba == ours else f"{ours}; numba: {numba}"


def read_cpu_model() -> str:
    """Return the name of the processor."""
    lines = _read_system_file("/proc/cpuinfo").splitlines()
    return next((x.split(":", 1)[1].strip() for x in lines if x.startswith("model name")), platform.processor())


@cache
def _find_target() -> Target | None:
    """Return the reference processor of this architecture; None if there is none or this one lacks a needed feature."""
    target = TARGETS.get(platform.machine())
    return target if target and target.needs <= read_processor_flags() else None


@cache
def read_processor_flags() -> frozenset[str]:
    """Return the processor's flags as Linux lists them (``Features`` on arm64); empty, thus unpinned, elsewhere."""
    lines = _read_system_file("/proc/cpuinfo").splitlines()
    return frozenset(next((x.partition(":")[2] for x in lines if x.startswith(("flags", "Features"))), "").split())


def _list_unwanted_features(target: Target) -> tuple[str, ...]:
    """Return the SIMD features, by NumPy's names, that this processor has and ``target`` lacks: they are disabled.

    NumPy warns about names that its build does not know, so its build is asked for the names it knows. This happens in
    a separate process, since NumPy reads the environment once, and the answer is cached for that build. The cache holds
    all names, as another processor of a cluster may read it. Empty if NumPy cannot be asked.
    """
    flags = read_processor_flags()
    names = _read_feature_names(kept := _locate_names_file())
    if names is None:
        bare = {k: v for k, v in os.environ.items() if not k.startswith("NPY_")}
        done = subprocess.run((sys.executable, "-c", ASK), capture_output=True, text=True, env=bare, check=False)
        names = done.stdout.strip()
        if done.returncode != 0 or not NAMES.fullmatch(names):
            return ()
        from .files import write_text  # imported here, since most starts write nothing

        with contextlib.suppress(OSError):
            kept.parent.mkdir(parents=True, exist_ok=True)
            write_text(kept, f"{names}\n{_digest(names)}\n")
    unwanted = set(names.split()) - target.loops
    # on x86-64 all unwanted features need AVX-512
    return tuple(sorted(n for n in unwanted if "avx512f" in flags or n.lower() in flags))


def _read_feature_names(kept: Path) -> str | None:
    """Return NumPy's names of SIMD features from the file ``kept``; None if it is missing or its digest differs."""
    with contextlib.suppress(OSError, UnicodeDecodeError):
        names, _, digest = read_cached_file(kept, LARGEST).decode().rstrip("\n").rpartition("\n")
        return names if digest == _digest(names) else None
    return None


def _digest(text: str) -> str:
    """Return a short digest of a text, 16 hexadecimal digits."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _locate_names_file() -> Path:
    """Return the path of the cached file with the SIMD features that this build of NumPy names, and their digest."""
    spec = importlib.util.find_spec("numpy")
    built = Path(spec.origin).stat().st_mtime_ns if spec and spec.origin else 0
    parts = importlib.metadata.version("numpy"), str(built), ASK
    name = f"numpy-{parts[0]}-{_digest(' '.join(parts))}.txt"
    return make_cache_folder("machine", ROOT / "results" / "local") / name


def _read_turbo() -> str:
    """Return ``on`` or ``off``, whether the processor may exceed its base clock; empty if the system does not say."""
    if (off := _read_system_file("/sys/devices/system/cpu/intel_pstate/no_turbo").strip()) in ("0", "1"):
        return "off" if off == "1" else "on"
    return {"1": "on", "0": "off"}.get(_read_system_file("/sys/devices/system/cpu/cpufreq/boost").strip(), "")


def _read_system_file(path: str) -> str:
    """Return the text of a file of the system; empty if it cannot be read."""
    try:
        return Path(path).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
