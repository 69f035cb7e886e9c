"""Checks for an engine's own tests: problems as numbers or files, tolerances derived from the exact motion."""
