"""Compiled mechanics: bundles of named arrays, functions entered by address, the kernel, the one way to march.

A method (folder ``methods``) is a step function on bundles: it calls the kernel's entries, ``run(k.accelerate)``, and
knows no joints. Whoever made an entry, loops over joints by kind or code of a whole mechanism, it reads and writes the
same arrays. Nothing is inlined across, so each function is compiled once and kept on disk (module ``entries``).
"""
