"""Machine code from expressions: CasADi expressions -> tape -> LLVM IR -> object file kept on disk -> address.

``compile_functions`` takes expressions and returns ``Code``, whose functions take pointers to flat arrays only:
straight-line functions of whole arrays, and loops over many elements with index tables. ``Program`` runs a list of
such calls from Python by one call. Importing this package does not import CasADi.
"""

from typing import TYPE_CHECKING, Any

from .code import Code, compile_functions
from .program import Program

if TYPE_CHECKING:
    from .functions import GeneratedFunction, Loop

__all__ = ["Code", "GeneratedFunction", "Loop", "Program", "compile_functions"]


def __getattr__(name: str) -> Any:
    if name not in ("GeneratedFunction", "Loop"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from . import functions

    return getattr(functions, name)
