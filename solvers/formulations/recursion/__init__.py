"""A mechanism in the coordinates of its joints by recursion over its bodies, which are data: compiled once for all."""
