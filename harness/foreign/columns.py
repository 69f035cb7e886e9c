"""Columns recognised by name: time, and for each body position, orientation, velocity and angular velocity.

Arrays by name, ``r`` (nt, nb, 3) or (nt, 3 nb), or one column a number: ``r_x``, ``r2_x``, ``x2``, ``body2.r.x``,
``q0`` to ``q3`` or ``qw`` to ``qz``, ``R11`` to ``R33``, ``phi``, ``theta``, ``psi``; bodies by number (from 1, or
from 0) or by name.
"""

import itertools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..catalogue.options import nearest
from ..files import FileError
from .tables import Table


@dataclass(frozen=True)
class Quantity:
    """Names it goes by, and its components in the order of the array; the first names of a component are preferred."""

    names: tuple[str, ...]
    components: tuple[tuple[str, ...], ...]
    unit: str


XYZ = (("x", "1"), ("y", "2"), ("z", "3"))
QUANTITIES = {
    "r": Quantity(("r", "pos", "position", "c", ""), (("x",), ("y",), ("z",)), "position of C"),
    "q": Quantity(
        ("q", "quat", "quaternion"), (("w", "0", "1"), ("x", "1", "2"), ("y", "2", "3"), ("z", "3", "4")), "quaternion"
    ),
    "R": Quantity(("r", "rot", "rotation"), tuple((f"{i}{j}",) for i in "123" for j in "123"), "rotation matrix"),
    "E": Quantity(
        ("", "euler", "angle", "e"), (("phi", "roll", "alpha", "1"), ("theta", "pitch", "beta", "2"),
        ("psi", "yaw", "gamma", "3")), "Euler angles",
    ),
    "v": Quantity(("v", "vel", "velocity"), XYZ, "velocity of C"),
    "Omega": Quantity(("omega", "w"), XYZ, "angular velocity"),
}  # fmt: skip


@dataclass(frozen=True)
class Quantities:
    """Quantities in a table, (nt, nb, .) each, their resolution in the same shape, and unused columns."""

    t: Float[np.ndarray, " nt"]
    quantities: Mapping[str, np.ndarray]
    resolution: Mapping[str, np.ndarray]
    unread: tuple[str, ...]
    numbered: bool  # quaternions of columns 0 to 3, or an array: their order is not in the names


def find_quantities(table: Table, body_names: tuple[str, ...], renamed: Mapping[str, str]) -> Quantities:
    """The quantities of ``table``, or FileError naming what is missing; ``renamed``: our names by theirs."""
    for theirs in renamed:
        if theirs not in table.columns:
            raise FileError(f"{table.path}: no column {theirs!r}{nearest(theirs, list(table.columns))}")
    columns = {_normalize_name(renamed.get(k, k)): a for k, a in table.columns.items()}
    resolution = {_normalize_name(renamed.get(k, k)): a for k, a in table.resolution.items()}
    time = next((k for k in ("t", "time") if k in columns), None)
    if time is None:
        raise FileError(f"{table.path}: no column t or time; its columns: {', '.join(table.columns)}")
    nb, nt = len(body_names), len(columns[time])
    quantities, coarse, numbered = {}, {}, False
    used: set[str] = {time}
    for name, quantity in QUANTITIES.items():
        width = len(quantity.components)
        whole = next(
            (k for k in _name_arrays(name, quantity, table, renamed) if columns[k].size == nt * nb * width), None
        )
        if whole is not None:
            quantities[name] = _reshape(columns[whole], nb, width)
            coarse[name] = _reshape(resolution[whole], nb, width)
            numbered |= name == "q"
            used.add(whole)
            continue
        keys, spelling = _find_columns(quantity, body_names, set(columns) - used)
        if not keys:
            continue
        quantities[name] = np.stack([columns[k] for k in keys], axis=1).reshape(nt, nb, width)
        coarse[name] = np.stack([resolution[k] for k in keys], axis=1).reshape(nt, nb, width)
        numbered |= name == "q" and spelling > 0
        used |= {*keys}
    if "r" not in quantities:
        wanted = "r_x, r_y, r_z" if nb == 1 else f"r1_x, r1_y, r1_z to r{nb}_z"
        raise FileError(
            f"{table.path}: no positions of {'the body' if nb == 1 else f'all {nb} bodies'}: expected {wanted}, or "
            f"--columns r_x=THEIRS,...; its columns: {', '.join(itertools.islice(table.columns, 20))}"
        )
    unread = tuple(k for k in table.columns if _normalize_name(renamed.get(k, k)) not in used)
    return Quantities(columns[time], quantities, coarse, unread, numbered)


def _normalize_name(name: str) -> str:
    """The name without units in brackets, punctuation and, but for a matrix R, capitals."""
    bare = re.sub(r"[\[(][^\])]*[\])]", "", name).strip()
    plain = re.sub(r"[^0-9a-zA-Z]+", "_", bare).strip("_")
    return plain if plain == "R" else plain.lower()


def _name_arrays(name: str, quantity: Quantity, table: Table, renamed: Mapping[str, str]) -> Iterator[str]:
    """Names of arrays that could be the whole quantity."""
    known = {_normalize_name(renamed.get(k, k)) for k, a in table.columns.items() if a.ndim > 1}
    spelt = ("R", "rot", "rotation") if name == "R" else quantity.names
    return (k for k in spelt if k in known)


def _reshape(a: np.ndarray, nb: int, width: int) -> np.ndarray:
    """(nt, nb, width) of (nt, nb, width), (nt, nb width), (nt, 3, 3) and what MATLAB makes of them, (nt, width, nb)."""
    if a.ndim == 3 and a.shape[1:] == (width, nb) and nb != width:
        a = np.swapaxes(a, 1, 2)
    if a.ndim == 4 and a.shape[1:] == (3, 3, nb) and nb != 3:
        a = np.moveaxis(a, 3, 1)
    return a.reshape(len(a), nb, width)


def _find_columns(quantity: Quantity, body_names: tuple[str, ...], known: set[str]) -> tuple[list[str], int]:
    """The column of each component of each body, none unless all are there, and which names of components they have."""
    nb = len(body_names)
    for first, k in itertools.product((1, 0), range(len(quantity.components[0]))):
        tags = [{str(b + first), _normalize_name(n)} | ({""} if nb == 1 else set()) for b, n in enumerate(body_names)]
        each = itertools.product(tags, (c[k] for c in quantity.components))
        keys = [next((s for s in _spell(quantity.names, *one) if s in known), "") for one in each]
        if all(keys):
            return keys, k
    return [], 0


def _spell(names: tuple[str, ...], tags: set[str], c: str) -> Iterator[str]:
    for name, tag in itertools.product(names, sorted(tags)):
        forms = [(name, tag, c), (f"{name}{tag}", c), (tag, name, c), (f"body{tag}", name, c)]
        forms += [] if tag else [(f"{name}{c}",)]
        if not c[0].isdigit():
            forms += [
                (f"{name}{c}{tag}",),
                (name, f"{c}{tag}"),
                (name, c, tag),
                (f"{name}{tag}{c}",),
                (tag, f"{name}{c}"),
            ]
        yield from ("_".join(p for p in form if p) for form in forms)
