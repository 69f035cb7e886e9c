"""Objects of machine code: made by LLVM, kept on disk, loaded for the life of a ``Code``.

A kept object is named by the SHA-256 of its IR, of the processor's name and features, and of llvmlite's version, and
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

from ....harness.cache import cache_folder
from ....harness.code_meter import making_code
from ....harness.machine import llvm_target
from ....harness.places import Place

if TYPE_CHECKING:
    from .functions import Loop, Straight

FOLDER = cache_folder("generated", Path(__file__).parent / "__pycache__")
LARGEST = 1 << 28  # bytes of an object
MOST = 1 << 29  # bytes of all that are kept: some thousand kernels
WAIT = 60.0  # [s] for another process to make an object: most take less than five
LEVEL = 1  # of optimisation: machine code alone; LLVM's passes gain nothing on tapes


class Code:
    """Functions loaded in this process. Their addresses are valid as long as this lives: keep it with them."""

    @making_code
    def __init__(self, ir: str | Callable[[], str], key: str = "") -> None:
        """From IR; or from what prints it, which is called only if nothing is kept under ``key``."""
        self._machine = _machine()
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), self._machine)
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(_object(ir, key, self._machine)))
        self._engine.finalize_object()

    def address(self, name: str) -> int:
        """Where function ``name`` begins; KeyError if there is none."""
        address = self._engine.get_function_address(name)
        if not address:
            raise KeyError(f"no function {name!r} in this code")
        return address

    def function(self, name: str, arguments: int) -> Callable[..., None]:
        """For calls from Python, with addresses of arrays."""
        return ctypes.PYFUNCTYPE(None, *[ctypes.c_void_p] * arguments)(self.address(name))


@making_code
def compile_functions(functions: "Mapping[str, Straight | Loop | tuple[Sequence[Any], Sequence[Any]]]") -> Code:
    """Code with one function for each name; a tuple (inputs, outputs) of CasADi's SX is a ``Straight``.

    Raises ValueError on operations of CasADi without counterpart, and on inputs that are not dense symbols.
    """
    return Code(print_functions(functions))


@making_code
def print_functions(functions: "Mapping[str, Straight | Loop | tuple[Sequence[Any], Sequence[Any]]]") -> str:
    """The IR of ``compile_functions``."""
    from .functions import Straight
    from .printing import print_module

    return print_module({k: Straight(*f) if isinstance(f, tuple) else f for k, f in functions.items()})


def _machine() -> llvm.TargetMachine:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    llvm.add_symbol("mbsbench_error", id(ArithmeticError))  # of code that raises; numba takes the name PyExc_...
    target = llvm.Target.from_triple(llvm.get_process_triple())
    cpu, features = llvm_target()
    return target.create_target_machine(cpu=cpu, features=features, opt=LEVEL, reloc="pic", codemodel="jitdefault")


def is_kept(key: str) -> bool:
    """Whether code is kept under ``key``."""
    return _place(key, _machine()).path.exists()


def _place(key: str, machine: llvm.TargetMachine) -> Place:
    version = f"{llvmlite.__version__} {llvm.llvm_version_info} {LEVEL}"
    name = hashlib.sha256("\0".join((key, *llvm_target(), machine.triple, version)).encode()).hexdigest()
    return Place(FOLDER) / f"{name}.o"


def _object(ir: str | Callable[[], str], key: str, machine: llvm.TargetMachine) -> bytes:
    """The object file of ``ir``, from disk if it is there."""
    place = _place(ir if isinstance(ir, str) else key, machine)
    if (content := _read(place)) is not None:
        return content
    with _alone(place):
        if (content := _read(place)) is not None:  # another process has made it meanwhile
            return content
        content = _compile(ir if isinstance(ir, str) else ir(), machine)
        with contextlib.suppress(OSError):  # nowhere to write
            FOLDER.mkdir(parents=True, exist_ok=True)
            place.write(hashlib.sha256(content).digest() + content, durable=False)
            _remove_oldest(FOLDER, MOST)
    return content


def _read(place: Place) -> bytes | None:
    """The object kept there; None if there is none, or a damaged one."""
    with contextlib.suppress(OSError):
        kept = place.read(LARGEST)
        digest, content = kept[:32], kept[32:]
        if hashlib.sha256(content).digest() == digest:
            os.utime(place.path)  # used: the last to be removed
            return content
    return None


@contextlib.contextmanager
def _alone(place: Place) -> Iterator[None]:
    """Keep other processes from making the same object meanwhile: each has a byte of one file to lock.

    Where no lock is to be had, or not within ``WAIT``, both make it.
    """
    with contextlib.ExitStack() as held:
        with contextlib.suppress(OSError):
            FOLDER.mkdir(parents=True, exist_ok=True)
            file = held.enter_context((Place(FOLDER) / "lock").open_file(os.O_RDWR | os.O_CREAT))
            until = time.monotonic() + WAIT  # not for ever: who holds it may be stopped, or on a machine that is gone
            while time.monotonic() < until:
                with contextlib.suppress(BlockingIOError):
                    fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, int(place.name[:15], 16))
                    break
                time.sleep(0.01)
        yield


def _remove_oldest(folder: Path, most: int) -> None:
    """Remove objects, those unused for longest first, until all take half of ``most`` bytes, if they take more.

    Another process may remove them too, or read one meanwhile: what it has opened stays readable.
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
    module = llvm.parse_assembly(ir)
    module.verify()
    return machine.emit_object(module)
