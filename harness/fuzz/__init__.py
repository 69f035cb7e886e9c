"""Random mechanisms in several presentations: a code must give one answer to all, and the right one."""
