"""Read mechanisms and motions of other programs; the rest of the package works without this room."""
