"""Submissions: run on hidden instances, ranked by error against CPU time."""
