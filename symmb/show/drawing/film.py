"""Films: the pictures of a run in sequence, as .gif by Pillow or as .mp4 by the program ffmpeg."""

import shutil
import subprocess
from collections.abc import Iterator
from typing import BinaryIO

import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array
from symmb.show.drawing.exhibit import Exhibit
from symmb.show.drawing.page import speed
from symmb.show.drawing.still import canvas, paint


def film(exhibit: Exhibit, file: BinaryIO, suffix: str) -> None:
    """Write the film of a run. A missing or failing program or package raises DeclarationError."""
    write, rate = FILMS[suffix]
    t = exhibit.drawing.t
    duration = float(np.ptp(t))
    count = max(int(duration / speed(duration) * rate), 1)
    at = np.linspace(t[0], t[-1], count)
    pictures = [int(k) for k in np.abs(t[:, None] - at).argmin(axis=0)]
    write(exhibit, pictures, file, rate)


def _pictures(exhibit: Exhibit, numbers: list[int]) -> Iterator[Array]:
    """Pixels (h, w, 3) of pictures."""
    some = numbers[:: max(len(numbers) // 40, 1)]  # these pictures determine the limits of the axes
    figure, axes = canvas(exhibit, some, dpi=90)
    limits = axes.get_xlim(), axes.get_ylim()
    picture, shown = np.empty(0), None
    for k in numbers:
        if k == shown:  # there are fewer output times than pictures
            yield picture
            continue
        axes.clear()
        axes.set_axis_off()
        axes.set_xlim(limits[0])
        axes.set_ylim(limits[1])
        paint(axes, exhibit, k)
        figure.canvas.draw()
        pixels = np.asarray(figure.canvas.buffer_rgba())[:, :, :3]  # pyright: ignore[reportAttributeAccessIssue]
        # A film needs even numbers of pixels.
        picture, shown = pixels[: len(pixels) // 2 * 2, : pixels.shape[1] // 2 * 2].copy(), k
        yield picture


def _gif(exhibit: Exhibit, numbers: list[int], file: BinaryIO, rate: int) -> None:
    try:
        from PIL import Image
    except ImportError:
        raise DeclarationError("A .gif needs Pillow. Run pip install pillow, or write .html.") from None
    images = [Image.fromarray(pixels).quantize(64) for pixels in _pictures(exhibit, numbers)]
    images[0].save(file, "GIF", save_all=True, append_images=images[1:], duration=1000 // rate, loop=0)


def _mp4(exhibit: Exhibit, numbers: list[int], file: BinaryIO, rate: int) -> None:
    program = shutil.which("ffmpeg")
    if program is None:
        raise DeclarationError("An .mp4 needs the program ffmpeg, which is not installed. Write .gif or .html.")
    pictures = _pictures(exhibit, numbers)
    first = next(pictures)
    size = f"{first.shape[1]}x{first.shape[0]}"
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", size, "-r", str(rate), "-i", "-"]
    target = ["-pix_fmt", "yuv420p", "-movflags", "frag_keyframe+empty_moov", "-f", "mp4", "-"]
    pixels = b"".join([first.tobytes(), *(picture.tobytes() for picture in pictures)])
    done = subprocess.run([program, "-loglevel", "error", *source, *target], input=pixels, capture_output=True)
    if done.returncode:
        raise DeclarationError(f"ffmpeg cannot write the film: {done.stderr.decode(errors='replace').strip()}")
    file.write(done.stdout)


FILMS = {".gif": (_gif, 20), ".mp4": (_mp4, 30)}
"""Writers of the film formats, and pictures per second."""
