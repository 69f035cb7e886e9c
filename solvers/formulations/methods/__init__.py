"""Methods as step functions on the kernel of ``compiled``: tableaux and schemes, with nothing about joints."""
