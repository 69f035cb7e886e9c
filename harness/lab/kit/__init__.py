"""Provide checks for the tests of an engine: problems as numbers or files, tolerances derived from the exact motion."""
