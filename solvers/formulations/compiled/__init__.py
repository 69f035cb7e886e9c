"""Compiled mechanics: bundles of named arrays, functions called by address, the kernel, and one march for all methods.

A method (folder ``methods``) is a step function on bundles: it calls the kernel's entries, ``run(k.accelerate)``, and
knows no joints. Whether an entry is loops over joints by kind or code of a whole mechanism, it reads and writes the
same arrays. Nothing is inlined across entries, so each function is compiled once and kept on disk (module ``entries``).
"""
