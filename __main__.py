"""Run the command line by ``python -m mbsbench``, for when the command ``mbsbench`` is not on the path."""

from .cli.__main__ import command_line

command_line()
