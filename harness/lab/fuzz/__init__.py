"""Test codes on random mechanisms in several presentations: all must have one answer, and the right one."""
