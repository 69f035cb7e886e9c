"""Rank submissions: run them on hidden instances and order them by error against CPU time."""
