"""Recognise columns by name: time, and for each body position, orientation, velocity and angular velocity.

Arrays have a name, ``r`` (nt, nb, 3) or (nt, 3 nb), or there is one column for each number: ``r_x``, ``r2_x``, ``x2``,
``body2.r.x``, ``q0`` to ``q3`` or ``qw`` to ``qz``, ``R11`` to ``R33``, ``phi``, ``theta``, ``psi``. Bodies have a
number (from 1, or from 0) or a name. A unit in brackets, or in a row of units, is applied, and refused if unknown; a
number in brackets is an index.
"""

import itertools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from ...base.files import FileError
from ...base.hints import suggest_name
from .conventions import ANGLES, LENGTHS, TIMES, Reading, find_factor
from .tables import Table


@dataclass(frozen=True)
class Quantity:
    """The names of a quantity and of its components, in the order of the array; preferred names come first."""

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
        ("", "euler", "angle", "e"),
        (("phi", "roll", "alpha", "1"), ("theta", "pitch", "beta", "2"), ("psi", "yaw", "gamma", "3")),
        "Euler angles",
    ),
    "v": Quantity(("v", "vel", "velocity"), XYZ, "velocity of C"),
    "Omega": Quantity(("omega", "w"), XYZ, "angular velocity"),
}


@dataclass(frozen=True)
class Quantities:
    """The quantities recognised in a table, (nt, nb, n) each, their resolution in the same shape, and unused columns.

    Those named in ``units`` are in SI units already; the others have the units that the user states.
    """

    t: Float[np.ndarray, " nt"]
    quantities: Mapping[str, np.ndarray]  # by name: r, q, R, E (Euler angles), v, Omega
    resolution: Mapping[str, np.ndarray]  # half a unit of the last printed digit
    unread: tuple[str, ...]  # names of columns not recognised
    numbered: bool  # quaternions in columns 0 to 3, or in an array: names do not show their order
    units: Mapping[str, str] = field(default_factory=dict)
    angles: tuple[str, ...] = ()  # names of Euler angles in the order of their columns
    notes: tuple[str, ...] = ()

    def factor(self, name: str, how: Reading) -> float:
        """Return the SI value of one unit of ``name``, a quantity or ``t``, as read with the units of ``how``.

        It is 1 if the file states a unit, which is applied already.
        """
        if name in self.units:
            return 1.0
        return {
            "t": TIMES[how.time],
            "r": LENGTHS[how.length],
            "v": LENGTHS[how.length],
            "E": ANGLES[how.angle],
            "Omega": ANGLES[how.angle],
        }[name]


def find_quantities(table: Table, body_names: tuple[str, ...], renamed: Mapping[str, str]) -> Quantities:
    """Return the quantities of ``table`` for all bodies of these names, in the units that the file states.

    One array for all bodies is preferred to a column per component. ``renamed`` maps names in the file to ours. Raise
    FileError if time or positions are missing, a column is read twice, or a unit or a name in ``renamed`` is unknown.
    """
    for asked in renamed:
        if asked not in table.columns:
            raise FileError(f"{table.path}: no column {asked!r}{suggest_name(asked, list(table.columns))}")
    theirs: dict[str, list[str]] = {}  # maps our names to those in the file
    for k in table.columns:
        theirs.setdefault(_normalize_name(renamed.get(k, k)), []).append(k)
    columns = {ours: table.columns[k[-1]] for ours, k in theirs.items()}
    resolution = {ours: table.resolution[k[-1]] for ours, k in theirs.items()}
    time = next((k for k in ("t", "time") if k in columns), None)
    if time is None:
        raise FileError(f"{table.path}: no column t or time; its columns: {', '.join(table.columns)}")
    nb, nt = len(body_names), len(columns[time])
    quantities, coarse, numbered = {}, {}, False
    angles: tuple[str, ...] = ()
    used: dict[str, list[str]] = {"t": [time]}
    for name, quantity in QUANTITIES.items():
        width = len(quantity.components)
        whole = next(
            (k for k in _list_array_names(name, quantity, table, renamed) if columns[k].size == nt * nb * width), None
        )
        if whole is not None:
            quantities[name] = _order_axes(columns[whole], nb, width)
            coarse[name] = _order_axes(resolution[whole], nb, width)
            numbered |= name == "q"
            used[name] = [whole]
            continue
        keys, spelling = _find_columns(quantity, body_names, set(columns) - {k for some in used.values() for k in some})
        if not keys:
            continue
        if name == "E":
            keys, angles = _sort_euler_angles(keys, [*columns], table)
        quantities[name] = np.stack([columns[k] for k in keys], axis=1).reshape(nt, nb, width)
        coarse[name] = np.stack([resolution[k] for k in keys], axis=1).reshape(nt, nb, width)
        numbered |= name == "q" and spelling > 0
        used[name] = keys
    if "r" not in quantities:
        wanted = "r_x, r_y, r_z" if nb == 1 else f"r0_x, r0_y, r0_z to r{nb - 1}_z"  # as messages count bodies
        raise FileError(
            f"{table.path}: no positions of {'the body' if nb == 1 else f'all {nb} bodies'}: expected {wanted}, or "
            f"--columns r_x=THEIRS,...; its columns: {', '.join(itertools.islice(table.columns, 20))}"
        )
    for keys in used.values():
        for k in keys:
            if len(theirs[k]) > 1:
                raise FileError(
                    f"{table.path}: columns {', '.join(map(repr, theirs[k]))} are all read as {k}; rename one"
                )
    t, units = columns[time], dict[str, str]()
    for name, keys in used.items():
        unit, factors = _read_units(table, name, [theirs[k][0] for k in keys])
        if not unit:
            continue
        units[name] = unit
        if name == "t":
            t = t * factors[0]
        else:
            each = np.array(factors).reshape(nb, -1) if len(factors) > 1 else factors[0]
            quantities[name], coarse[name] = quantities[name] * each, coarse[name] * each
    known = {k for keys in used.values() for k in keys}
    unread = tuple(k for k in table.columns if _normalize_name(renamed.get(k, k)) not in known)
    return Quantities(t, quantities, coarse, unread, numbered, units, angles, table.notes)


def _read_units(table: Table, name: str, names: list[str]) -> tuple[str, list[float]]:
    """Return the unit that the file gives the quantity ``name``, and the SI value of one unit for each of its columns.

    ``names`` are the columns' names in the file. Both are empty if it gives none. Raise FileError for an unknown unit,
    or if only some of the columns have one.
    """
    given = [table.units.get(k) or split_name(k)[1] for k in names]
    if table.angle and not any(given):
        given = [{"E": table.angle, "Omega": f"{table.angle}/s"}.get(name, "")] * len(names)
    if not any(given):
        return "", []
    factors = list[float]()
    for k, unit in zip(names, given, strict=True):
        if (factor := find_factor(unit, name)) is None:
            words = "time" if name == "t" else QUANTITIES[name].unit
            said = f"{unit!r} is not known as a unit of it" if unit else "it has no unit, others of it have one"
            raise FileError(
                f"{table.path}: column {k!r}, read as {words}: {said}; rename it: --columns OURS=THEIRS,..."
            )
        factors.append(factor)
    return next(filter(None, given)), factors


def _sort_euler_angles(keys: list[str], known: list[str], table: Table) -> tuple[list[str], tuple[str, ...]]:
    """Return the columns of Euler angles in their order in the file, body by body, and their names for the first body.

    ``keys`` are the columns, three per body, ``known`` all columns. Raise FileError if the order differs between
    bodies.
    """
    bodies = [keys[k : k + 3] for k in range(0, len(keys), 3)]
    orders = {tuple(np.argsort([known.index(k) for k in body])) for body in bodies}
    if len(orders) > 1:
        raise FileError(f"{table.path}: the Euler angles of its bodies are in different orders")
    (order,) = orders
    names = [next((c for c in ("roll", "pitch", "yaw") if c in k), k) for k in bodies[0]]
    return [body[k] for body in bodies for k in order], tuple(names[k] for k in order)


def split_name(name: str) -> tuple[str, str]:
    """Return the name of a column without its unit, and the unit in brackets.

    A number in brackets stays as an index.
    """
    bare = re.sub(r"[\[(]\s*(\d+(?:\s*,\s*\d+)*)\s*[\])]", lambda m: "_" + re.sub(r"\D", "", m[1]), name)
    units = re.findall(r"[\[(]([^\])]*)[\])]", bare)
    return re.sub(r"[\[(][^\])]*[\])]", "", bare).strip(), (units[-1].strip() if units else "")


def _normalize_name(name: str) -> str:
    """Return the name without units, with ``_`` for punctuation, in lower case except for a matrix R."""
    plain = re.sub(r"[^0-9a-zA-Z]+", "_", split_name(name)[0]).strip("_")
    return plain if plain == "R" else plain.lower()


def _list_array_names(name: str, quantity: Quantity, table: Table, renamed: Mapping[str, str]) -> Iterator[str]:
    """Return the names of arrays in the table that may hold the quantity for all bodies, preferred names first."""
    known = {_normalize_name(renamed.get(k, k)) for k, a in table.columns.items() if a.ndim > 1}
    spelt = ("R", "rot", "rotation") if name == "R" else quantity.names
    return (k for k in spelt if k in known)


def _order_axes(a: np.ndarray, nb: int, width: int) -> np.ndarray:
    """Return the array of a quantity with ``width`` components as (nt, nb, width), from any shape that files have.

    Shapes are (nt, nb width), (nt, nb, width) and MATLAB's (nt, width, nb); for rotation matrices, of width 9, also
    (nt, nb, 3, 3), MATLAB's (nt, 3, 3, nb), and (nt, 3, 3) of a single body. Where nb equals the size of the axis that
    it could be confused with (``width``, or 3 for matrices), bodies are taken to come first.
    """
    if a.ndim == 3 and a.shape[1:] == (width, nb) and nb != width:
        a = np.swapaxes(a, 1, 2)
    if a.ndim == 4 and a.shape[1:] == (3, 3, nb) and nb != 3:
        a = np.moveaxis(a, 3, 1)
    return a.reshape(len(a), nb, width)


def _find_columns(quantity: Quantity, body_names: tuple[str, ...], known: set[str]) -> tuple[list[str], int]:
    """Return the columns of a quantity's components, body by body, and which of the components' names they have.

    The names are alternatives, counted from 0. No columns are returned unless all exist. Bodies may have their names,
    or numbers from 1 or from 0.
    """
    nb = len(body_names)
    for first_number, k in itertools.product((1, 0), range(len(quantity.components[0]))):
        tags = [{str(b + first_number), _normalize_name(name)} for b, name in enumerate(body_names)]
        tags = [{*tags[0], ""}] if nb == 1 else tags  # a single body needs no tag
        each = itertools.product(tags, (names[k] for names in quantity.components))
        keys = [next((s for s in _list_spellings(quantity.names, *one) if s in known), "") for one in each]
        if all(keys) and len(set(keys)) == len(keys):  # in a file that counts from 0 ``body1`` is not the first
            return keys, k
    return [], 0


def _list_spellings(names: tuple[str, ...], tags: set[str], c: str) -> Iterator[str]:
    """Yield all spellings of component ``c`` of a body with the numbers or names ``tags``, preferred names first."""
    for name, tag in itertools.product(names, sorted(tags)):
        forms = [(name, tag, c), (f"{name}{tag}", c), (tag, name, c), (f"body{tag}", name, c), ("body", tag, name, c)]
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
