"""The nearest true motion of a computed one, and the modified energy of a fixed-step method, from its trajectory."""
