"""Write publication figures and tables of a results folder, or the paper's own figures (``figures``)."""

import argparse

from ..harness.catalogue.suites.suite import load_suite
from ..harness.results import store
from .arguments import UsageError, parse_assignments
from .terminal import make_console


def run(arguments: argparse.Namespace) -> int:
    """Write the figures of results, or with --paper the paper's; print a line on each and their folder; return 0."""
    folder = arguments.results
    if arguments.paper and arguments.name:
        raise UsageError("--name is for figures of your own; those of --paper have the paper's names")
    from ..reports import publication  # here: they take a second to load
    from ..reports.paper import build as paper
    from ..reports.plots.fonts import find_font

    font = find_font(arguments.font, arguments.font_size)
    out = make_console()
    with store.hold_folder(folder):
        if arguments.paper:
            paper.draw_figures(folder, arguments.only, load_suite("paper").specs, out.print, font=font)
        else:
            publication.write_publication(
                folder, arguments.only, out.print, parse_assignments(arguments.name, "--name"), font
            )
    out.print(f"figures: {folder / (paper if arguments.paper else publication).FOLDER}")
    return 0
