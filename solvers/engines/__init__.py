"""External engines as solvers: one public file each; their common parts are in ``export``."""
