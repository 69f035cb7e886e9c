"""Pictures into a file: GIF by Pillow, MP4 by ffmpeg where there is one."""

import shutil
import subprocess
from collections.abc import Iterable
from itertools import chain
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from ....harness.files import whole

Picture = UInt8[np.ndarray, "height width 3"]
COLOURS = 64  # of a GIF: lines, text and a little smoothing


def check_kind(out: Path) -> None:
    """ValueError if this file cannot be written, before anything is drawn."""
    if out.suffix.lower() not in (".gif", ".mp4"):
        raise ValueError(f"an animation is a .gif or an .mp4 (got {out.name!r})")
    if out.suffix.lower() == ".mp4" and ffmpeg() is None:
        raise ValueError("an .mp4 needs ffmpeg: install it, or `pip install imageio-ffmpeg`, or ask for a .gif")


def write(pictures: Iterable[Picture], out: Path, fps: int) -> None:
    """Replaced whole."""
    with whole(out) as partial:
        (_gif if out.suffix.lower() == ".gif" else _mp4)(pictures, partial, fps)


def ffmpeg() -> str | None:
    """The program on the path, or that of the package imageio-ffmpeg."""
    found = shutil.which("ffmpeg")
    if found:
        return found
    try:
        import imageio_ffmpeg

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        return None


def _gif(pictures: Iterable[Picture], out: Path, fps: int) -> None:
    """One palette for all pictures, so that only what moves is stored."""
    source = iter(pictures)
    first = Image.fromarray(next(source))
    palette = first.quantize(COLOURS, dither=Image.Dither.NONE)
    colours = np.asarray(palette.getpalette() or [], dtype=int).reshape(-1, 3)
    colours[colours.min(axis=1) >= 246] = 255  # paper stays white
    palette.putpalette(colours.ravel().tolist())

    rest = (Image.fromarray(p).quantize(palette=palette, dither=Image.Dither.NONE) for p in source)
    duration = max(round(100.0 / fps), 2) * 10  # [ms] GIF counts in hundredths, and viewers slow down below two
    palette.save(out, "GIF", save_all=True, append_images=rest, duration=duration, loop=0, optimize=False)


def _mp4(pictures: Iterable[Picture], out: Path, fps: int) -> None:
    source = iter(pictures)
    first = next(source)
    height, width = first.shape[:2]
    command = [
        str(ffmpeg()), "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}",
        "-r", str(fps), "-i", "-", "-an", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "22",
        "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-movflags", "+faststart", str(out),
    ]  # fmt: skip
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None and process.stderr is not None
        try:
            for picture in chain([first], source):
                process.stdin.write(picture.tobytes())
            process.stdin.close()
        except BrokenPipeError:
            pass  # it says why below
        said = process.stderr.read().decode("utf-8", "replace")
    if process.returncode:
        raise ValueError(f"ffmpeg failed: {' '.join(said.split())[-300:]}")
