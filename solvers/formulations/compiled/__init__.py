"""Compiled mechanics: bundles of named arrays, functions called by address, the kernel, and the march of all methods.

A method (folder ``methods``) is a step function on bundles: it calls the kernel's entries, ``run(k.accelerate)``, and
contains nothing about joints. An entry may be loops over joints by kind or code of a whole mechanism; both read and
write the same arrays. Nothing is inlined across entries, so each function is compiled once and kept on disk (module
``entries``).
"""
