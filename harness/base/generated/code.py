"""Object files of machine code: made by LLVM, kept on disk, loaded for the life of a ``Code``.

A kept object is named by the SHA-256 of its IR, of the processor's name and features, and of llvmlite's version. It
begins with the digest of its content: one that is damaged or cut short is made again, since LLVM would crash on it.
"""

import contextlib
import ctypes
import fcntl
import hashlib
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import llvmlite
import llvmlite.binding as llvm

from ..cache import make_cache_folder
from ..code_meter import making_code
from ..confined_paths import ConfinedPath
from ..machine import find_llvm_target

if TYPE_CHECKING:
    from .functions import GeneratedFunction, Loop

FOLDER = make_cache_folder("generated", Path(__file__).parent / "__pycache__")
LARGEST = 1 << 28  # bytes of an object
MOST_BYTES = 1 << 29  # bytes of all that are kept: some thousand kernels
WAIT = 60.0  # [s] for another process to make an object: most take less than five
LEVEL = 1  # level of optimisation: machine code alone; LLVM's passes gain nothing on tapes


class Code:
    """Functions of machine code loaded in this process; their addresses are valid as long as this object lives."""

    @making_code
    def __init__(self, ir: str | Callable[[], str], key: str = "") -> None:
        """Load the code of ``ir``, or of the IR that this function returns.

        A function needs a ``key``, and is called only if no object is kept on disk under it.
        """
        self._machine = _make_target_machine()
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), self._machine)
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(_load_object(ir, key, self._machine)))
        self._engine.finalize_object()

    def address(self, name: str) -> int:
        """Return the address of function ``name``; raise KeyError if there is none."""
        address = self._engine.get_function_address(name)
        if not address:
            raise KeyError(f"no function {name!r} in this code")
        return address

    def function(self, name: str, arguments: int) -> Callable[..., None]:
        """Return function ``name`` as a Python callable of that many ``arguments``, the addresses of arrays."""
        return ctypes.PYFUNCTYPE(None, *[ctypes.c_void_p] * arguments)(self.address(name))


@making_code
def compile_functions(
    functions: "Mapping[str, GeneratedFunction | Loop | tuple[Sequence[Any], Sequence[Any]]]",
) -> Code:
    """Compile one function for each name; a tuple (inputs, outputs) of CasADi's SX is a ``GeneratedFunction``.

    Raises ValueError for operations of CasADi without a counterpart, and for inputs that are not dense symbols.
    """
    return Code(print_functions(functions))


@making_code
def print_functions(functions: "Mapping[str, GeneratedFunction | Loop | tuple[Sequence[Any], Sequence[Any]]]") -> str:
    """Return the LLVM IR that ``compile_functions`` compiles, one function for each name."""
    from .functions import GeneratedFunction
    from .printing import print_module

    return print_module({k: GeneratedFunction(*f) if isinstance(f, tuple) else f for k, f in functions.items()})


def _make_target_machine() -> llvm.TargetMachine:
    """Return LLVM's description of the processor that code is made for, with the address of ``mbsbench_error`` set."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    llvm.add_symbol("mbsbench_error", id(ArithmeticError))  # for code that raises; numba uses the name PyExc_...
    target = llvm.Target.from_triple(llvm.get_process_triple())
    cpu, features = find_llvm_target()
    return target.create_target_machine(cpu=cpu, features=features, opt=LEVEL, reloc="pic", codemodel="jitdefault")


def is_kept(key: str) -> bool:
    """Return whether an object of code is kept on disk under ``key``, for this processor and version of LLVM."""
    return _locate_object(key, _make_target_machine()).path.exists()


def _locate_object(key: str, machine: llvm.TargetMachine) -> ConfinedPath:
    """Return the path of the object file of ``key``, named by a digest of it, the processor and LLVM's version."""
    version = f"{llvmlite.__version__} {llvm.llvm_version_info} {LEVEL}"
    name = hashlib.sha256("\0".join((key, *find_llvm_target(), machine.triple, version)).encode()).hexdigest()
    return ConfinedPath(FOLDER) / f"{name}.o"


def _load_object(ir: str | Callable[[], str], key: str, machine: llvm.TargetMachine) -> bytes:
    """Return the content of the object file of ``ir``, from the cache on disk if it is there.

    Else ``ir`` is compiled and the object added to the cache, from which the oldest objects are removed when all take
    more than ``MOST_BYTES``; if the disk cannot be written, it is only returned. If ``ir`` is a function that returns
    the IR, ``key`` names the object and the function is called only to compile; else the IR itself names it.
    """
    place = _locate_object(ir if isinstance(ir, str) else key, machine)
    if (content := _read_object(place)) is not None:
        return content
    with _lock_object(place):
        if (content := _read_object(place)) is not None:  # another process has made it meanwhile
            return content
        content = _compile(ir if isinstance(ir, str) else ir(), machine)
        with contextlib.suppress(OSError):  # no place to write
            FOLDER.mkdir(parents=True, exist_ok=True)
            place.write(hashlib.sha256(content).digest() + content, durable=False)
            _remove_oldest(FOLDER, MOST_BYTES)
    return content


def _read_object(place: ConfinedPath) -> bytes | None:
    """Return the content of the object file at ``place`` and mark it as used; None if it is missing or damaged."""
    with contextlib.suppress(OSError):
        kept = place.read(LARGEST)
        digest, content = kept[:32], kept[32:]
        if hashlib.sha256(content).digest() == digest:
            os.utime(place.path)  # marks it as used: it is removed last
            return content
    return None


@contextlib.contextmanager
def _lock_object(place: ConfinedPath) -> Iterator[None]:
    """Hold a lock in this context, by which other processes wait until the object at ``place`` is made.

    Each object has a byte of one file to lock. Without a lock, or if it is not free within ``WAIT`` [s], both processes
    make the object.
    """
    with contextlib.ExitStack() as held:
        with contextlib.suppress(OSError):
            FOLDER.mkdir(parents=True, exist_ok=True)
            file = held.enter_context((ConfinedPath(FOLDER) / "lock").open_file(os.O_RDWR | os.O_CREAT))
            until = time.monotonic() + WAIT  # not for ever: the holder may be stopped, or on a machine that is down
            while time.monotonic() < until:
                with contextlib.suppress(BlockingIOError):
                    fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, int(place.name[:15], 16))
                    break
                time.sleep(0.01)
        yield


def _remove_oldest(folder: Path, most: int) -> None:
    """Remove objects, those unused for longest first, if all take more than ``most`` bytes, until they take half of it.

    Another process may do the same, or read one meanwhile: a file that it has opened stays readable.
    """
    found = list[tuple[float, int, Path]]()
    for path in folder.glob("*.o"):
        with contextlib.suppress(FileNotFoundError):
            about = path.lstat()
            found.append((about.st_mtime, about.st_size, path))
    total = sum(size for _, size, _ in found)
    if total > most:
        for _, size, path in sorted(found):
            path.unlink(missing_ok=True)
            total -= size
            if total <= most // 2:
                return


def _compile(ir: str, machine: llvm.TargetMachine) -> bytes:
    """Return the object file that LLVM makes of ``ir``."""
    module = llvm.parse_assembly(ir)
    module.verify()
    return machine.emit_object(module)
