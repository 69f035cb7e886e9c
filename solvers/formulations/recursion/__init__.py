"""A mechanism in joint coordinates by recursion over its bodies as data, compiled once for all mechanisms."""
