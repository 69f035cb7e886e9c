"""Pin what of this machine decides the bits of a run, before NumPy loads, and describe what is in force.

Three libraries choose instructions by the processor: OpenBLAS its kernels, NumPy its loops, LLVM (numba, and our own
code) what it compiles for. Each reads the environment once, when it loads. ``pin`` sets all three to what every
processor with AVX2 has, so that all of them round alike; what is preset loses. ``MBSBENCH_NATIVE=1``, or ``--native``
of a command, turns it off; ``MBSBENCH_CORE`` chooses other kernels of OpenBLAS, and nothing else.
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

from .cache import ROOT, cache_folder, read_kept

LARGEST = 2**16  # [bytes] of the file with NumPy's names
NATIVE = "MBSBENCH_NATIVE"
CORE = "MBSBENCH_CORE"  # the pin with the kernels of this core type of OpenBLAS: only the rounding of BLAS is other
ENABLED = "NPY_ENABLE_CPU_FEATURES"  # beside the names of what is disabled, NumPy refuses to load
THREADS = dict.fromkeys((  # one thread: timings mean CPU time of one core, and results do not depend on how many
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS", "NUMBA_NUM_THREADS",
), "1")  # fmt: skip


class Target(NamedTuple):
    """A processor that all those of one architecture are taken for."""

    kernels: str  # OpenBLAS, by its name of a core type
    compiled: str  # LLVM's name of a processor; its features are those that the name stands for
    needs: frozenset[str]  # flags of /proc/cpuinfo without which the code would not run; abm: lzcnt
    loops: frozenset[str]  # NumPy's names of the features that its loops may use


TARGETS = {
    "x86_64": Target(
        "Haswell", "haswell", frozenset(("avx2", "fma", "bmi1", "bmi2", "movbe", "abm", "f16c")),
        frozenset(("SSE", "SSE2", "SSE3", "SSSE3", "SSE41", "SSE42", "POPCNT", "AVX", "F16C", "FMA3", "AVX2",
                   "X86_V2", "X86_V3")),
    ),
    "aarch64": Target(
        "ARMV8", "generic", frozenset(("asimd",)), frozenset(("NEON", "NEON_FP16", "NEON_VFPV4", "ASIMD"))
    ),
}  # fmt: skip
ASK = "import numpy; s = numpy.show_config('dicts')['SIMD Extensions']; print(*s['found'], *s.get('not found', ()))"
NAMES = re.compile(r"[A-Z0-9_ ]*")
_before: dict[str, str | None] = {}  # what ``pin`` found preset, for ``unpin``


def pin() -> None:
    """Set the environment of this process, and of all that it starts, so that runs have the same bits everywhere.

    Nothing changes for libraries that are loaded already: ``find_deviations`` names them.
    """
    if os.environ.get(NATIVE) == "1":
        return
    for name, value in variables().items():
        if name.startswith("NUMBA_") and "numba" in sys.modules:
            continue  # it compiles on as it began, but would read these, and keep that code under their name
        _before.setdefault(name, os.environ.get(name))
        os.environ[name] = value
    if variables():
        _before.setdefault(ENABLED, os.environ.pop(ENABLED, None))


def unpin() -> None:
    """Give back what ``pin`` found, here and in all that this process starts: before NumPy loads, or for children."""
    os.environ[NATIVE] = "1"
    for name, value in _before.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
    _before.clear()


@cache
def variables() -> dict[str, str]:
    """Return the environment variables of the pin; none where this processor cannot be taken for the common one."""
    target = _target()
    if target is None:
        return {}
    return {
        "OPENBLAS_CORETYPE": os.environ.get(CORE) or target.kernels,
        "NPY_DISABLE_CPU_FEATURES": " ".join(_list_unwanted(target)),
        "NUMBA_CPU_NAME": target.compiled, "NUMBA_CPU_FEATURES": "",
    }  # fmt: skip


def llvm_target() -> tuple[str, str]:
    """Return name and features of the processor that our code is compiled for."""
    if os.environ.get(NATIVE) != "1" and (target := _target()) is not None:
        return target.compiled, ""
    return _host()


def numba_target() -> tuple[str, str]:
    """Return name and features of the processor that numba compiles for, or will when it is loaded."""
    config = sys.modules.get("numba.core.config")
    name = config.CPU_NAME if config else os.environ.get("NUMBA_CPU_NAME")
    features = config.CPU_FEATURES if config else os.environ.get("NUMBA_CPU_FEATURES")
    return name or _host()[0], _host()[1] if features is None else features


@cache
def _host() -> tuple[str, str]:
    import llvmlite.binding as llvm

    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def find_deviations() -> list[str]:
    """Name each library of this process that does not keep to the pin; NumPy is loaded for it."""
    target = _target()
    if target is None:
        return [f"this processor ({platform.machine()}, {platform.system()}) is none that the pin knows"]
    loops = sorted(set(list_features()) - target.loops)
    kernels = sorted({k for k in list_kernels() if k and k.lower() != target.kernels.lower()})
    cpu, pinned = llvm_target()[0], (target.compiled, "")
    tunables = os.environ.get("GLIBC_TUNABLES", "")  # read before anything of ours: it cannot be pinned
    return [
        *([f"NumPy uses {', '.join(loops)}"] if loops else []),
        *([f"OpenBLAS uses kernels of {', '.join(kernels)}"] if kernels else []),
        *([f"LLVM compiles for {cpu}"] if cpu != target.compiled else []),
        *([f"numba compiles for {numba_target()[0]}"] if numba_target() != pinned else []),
        *(["GLIBC_TUNABLES chooses functions of the C library"] if "glibc.cpu.hwcaps" in tunables else []),
    ]


@cache
def name_arithmetic() -> str:
    """Return a name for the bits that this process computes, for what it keeps on disk: "" for those of the pin."""
    found = find_deviations()
    return _digest("; ".join(found)) if found else ""


def explain_deviations() -> str:
    """Return a line for who computes here, if the bits are not those of the pin; "" where they are, and natively."""
    found = [] if os.environ.get(NATIVE) == "1" else find_deviations()
    words = "these runs have the bits of this processor, not those that runs have everywhere"
    return f"{words} ({'; '.join(found)})" if found else ""


def list_kernels() -> list[str]:
    """List the core types whose kernels the loaded BLAS libraries use, as ``threadpoolctl`` names them."""
    from threadpoolctl import threadpool_info

    return [str(b.get("architecture") or "") for b in threadpool_info() if b.get("user_api") == "blas"]


def list_features() -> list[str]:
    """List the SIMD features in force in NumPy, of those that it chooses from while it runs."""
    import numpy

    return list(numpy.show_config(mode="dicts")["SIMD Extensions"]["found"])


def describe() -> dict[str, Any]:
    """Return what decides bits and times here, as ``environment.json`` has it.

    ``pinned``; NumPy's SIMD features, LLVM's processor, libc; the governor of the clock, turbo, and the load [1] of the
    last minute. What the system does not tell is empty.
    """
    governor = _read("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor").strip()
    libc = " ".join(platform.libc_ver()).strip() or platform.system()
    return {
        "pinned": not find_deviations(), "simd": list_features(), "llvm": _describe_compilers(),
        "libc": libc, "governor": governor, "turbo": _turbo(), "load": round(os.getloadavg()[0], 2),
    }  # fmt: skip


def _describe_compilers() -> str:
    ours, numba = (" ".join(filter(None, target)) for target in (llvm_target(), numba_target()))
    return ours if numba == ours else f"{ours}; numba: {numba}"


def cpu_model() -> str:
    """Return the name of the processor."""
    lines = _read("/proc/cpuinfo").splitlines()
    return next((x.split(":", 1)[1].strip() for x in lines if x.startswith("model name")), platform.processor())


@cache
def _target() -> Target | None:
    target = TARGETS.get(platform.machine())
    return target if target and target.needs <= processor_flags() else None


@cache
def processor_flags() -> frozenset[str]:
    """Flags of the processor as Linux lists them (``Features`` on arm64); none on other systems: nothing is pinned."""
    lines = _read("/proc/cpuinfo").splitlines()
    return frozenset(next((x.partition(":")[2] for x in lines if x.startswith(("flags", "Features"))), "").split())


def _list_unwanted(target: Target) -> tuple[str, ...]:
    """NumPy's names of what it is to do without: it complains of names that its build does not choose from.

    So it is asked, in a process of its own as it reads the environment once, and its answer is kept for that build:
    all names, since another processor of a cluster may read them. Of these, those that this processor has.
    """
    flags = processor_flags()
    names = _read_names(kept := _kept_names())
    if names is None:
        bare = {k: v for k, v in os.environ.items() if not k.startswith("NPY_")}
        done = subprocess.run((sys.executable, "-c", ASK), capture_output=True, text=True, env=bare, check=False)
        names = done.stdout.strip()
        if done.returncode != 0 or not NAMES.fullmatch(names):
            return ()
        from .files import write_text  # here: most starts write nothing

        with contextlib.suppress(OSError):
            kept.parent.mkdir(parents=True, exist_ok=True)
            write_text(kept, f"{names}\n{_digest(names)}\n")
    unwanted = set(names.split()) - target.loops
    return tuple(sorted(n for n in unwanted if "avx512f" in flags or n.lower() in flags))  # all of x86-64 need AVX-512


def _read_names(kept: Path) -> str | None:
    """The names in a file that is whole, as its last line shows; else None: without them nothing would be pinned."""
    with contextlib.suppress(OSError, UnicodeDecodeError):
        names, _, digest = read_kept(kept, LARGEST).decode().rstrip("\n").rpartition("\n")
        return names if digest == _digest(names) else None
    return None


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _kept_names() -> Path:
    """The file with the names that this build of NumPy has, and their digest."""
    spec = importlib.util.find_spec("numpy")
    built = Path(spec.origin).stat().st_mtime_ns if spec and spec.origin else 0
    parts = importlib.metadata.version("numpy"), str(built), ASK
    name = f"numpy-{parts[0]}-{_digest(' '.join(parts))}.txt"
    return cache_folder("machine", ROOT / "results" / "local") / name


def _turbo() -> str:
    if (off := _read("/sys/devices/system/cpu/intel_pstate/no_turbo").strip()) in ("0", "1"):
        return "off" if off == "1" else "on"
    return {"1": "on", "0": "off"}.get(_read("/sys/devices/system/cpu/cpufreq/boost").strip(), "")


def _read(path: str) -> str:
    try:
        return Path(path).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
