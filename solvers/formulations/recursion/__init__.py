"""A mechanism in joint coordinates by recursion over its bodies, which are data: compiled once for all mechanisms."""
