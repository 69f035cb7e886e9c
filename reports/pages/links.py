"""From the digests in judgement files to cells of this run: their words, their solver, their page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..model.reading import Cell


@dataclass(frozen=True)
class Links:
    """Cells by what judgements call them: the digest of their settings, or their own."""

    cells: Mapping[str, Cell]

    def cell(self, key: str) -> Cell | None:
        return self.cells.get(key)

    def words(self, key: str) -> str:
        """The settings in words; a cell that is not here keeps the head of its digest."""
        cell = self.cells.get(key)
        return cell.record.case if cell else f"{key[:12]} (not in this run)"

    def solver(self, key: str) -> str:
        cell = self.cells.get(key)
        return cell.record.solver if cell else ""

    def page(self, key: str) -> str:
        """The address of its page, as seen from a page of the report; empty for a cell that is not here."""
        cell = self.cells.get(key)
        return page_of(cell) if cell else ""


def links_of(cells: Sequence[Cell]) -> Links:
    """Of a run."""
    return Links({**{c.record.cell: c for c in cells}, **{c.record.settings: c for c in cells}})


def page_of(cell: Cell) -> str:
    """The address of a cell's page."""
    return f"cells/{cell.record.cell}.html"
