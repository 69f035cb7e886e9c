"""The engines' side of ``export.protocol``: files that import numpy, their engine and each other alone."""
