"""``python -m mbsbench``: the command line, where the command ``mbsbench`` is not on the path."""

from .cli.__main__ import command_line

command_line()
