"""Meshes and textures that stand for those that a collection of models lacks: a tetrahedron, a grey square.

MuJoCo compiles no model without them, although only shapes that give a body its mass matter to a motion.
"""

import re
import struct
import zlib

ASSET = re.compile(r"(?<=')[^']*\.(obj|stl|png)(?=')", re.IGNORECASE)  # a file in a message of MuJoCo
CORNERS = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))  # of a tetrahedron, and its faces
FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
LOOKS = {  # what stands for a file that is not there, by its format
    "obj": "".join(
        [f"v {x} {y} {z}\n" for x, y, z in CORNERS] + [f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in FACES]
    ).encode(),
    "stl": struct.pack("<80xI", len(FACES))
    + b"".join(struct.pack("<12f2x", 0, 0, 0, *(x for k in face for x in CORNERS[k])) for face in FACES),
    "png": b"\x89PNG\r\n\x1a\n"
    + b"".join(
        struct.pack(">I", len(part)) + kind + part + struct.pack(">I", zlib.crc32(kind + part))
        for kind, part in (
            (b"IHDR", struct.pack(">IIBBBBB", 6, 6, 8, 2, 0, 0, 0)),  # 6 by 6 points of three colours
            (b"IDAT", zlib.compress(6 * (b"\0" + 18 * b"\x7f"))),
            (b"IEND", b""),
        )
    ),
}
