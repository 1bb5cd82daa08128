# SPDX-License-Identifier: Apache-2.0
"""Videos: .mp4 with H.264, which every browser plays, and .gif."""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pm01_nav.config import check_output, make_folder
from pm01_nav.errors import InputError

Frame = NDArray[np.uint8]

COLORS = 256
"""As many as a .gif can have; half as many save 5 % of the file and the robot turns brown."""
EXACT_COLORS = 64
"""The most frequent ones are kept as they are."""
PALETTE_FRAMES = 12
"""So many frames, spread over the video, choose the colours."""
GIF_TICK_MS = 10
"""A .gif counts time in hundredths of a second."""


def write_video(frames: Iterable[Frame], path: str | Path, fps: float) -> None:
    """Write RGB frames (height, width, 3) to an .mp4 or a .gif; ``path`` only ever is complete.

    Raises:
        InputError: the suffix or ``fps`` is not allowed, there are no frames, their sizes differ
            or are odd for an .mp4, the packages for video are not installed, or the path cannot be
            written to.
    """
    path = Path(path)
    if path.suffix.lower() not in WRITERS:
        raise InputError(f"video {path}: unknown suffix; allowed: {', '.join(WRITERS)}")
    if not 0.0 < fps <= 1000.0:
        raise InputError(f"fps = {fps}: must be above 0 and at most 1000")
    make_folder(path.parent, "output")
    check_output(path)
    # Beside the target, so that the last step is a rename within one file system.
    partial = path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")
    try:
        WRITERS[path.suffix.lower()](_alike(frames, path), partial, fps)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def _alike(frames: Iterable[Frame], path: Path) -> Iterator[Frame]:
    """Pass on frames of one size, at least one of them."""
    shape: tuple[int, ...] | None = None
    for frame in frames:
        shape = shape or frame.shape
        if frame.shape != shape or frame.ndim != 3 or frame.shape[2] != 3:
            raise InputError(f"video {path}: a frame is {frame.shape} instead of {shape[:2]} x 3")
        yield np.ascontiguousarray(frame, dtype=np.uint8)
    if shape is None:
        raise InputError(f"video {path}: there are no frames to write")


def _write_mp4(frames: Iterator[Frame], path: Path, fps: float) -> None:
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise InputError(f"{path.suffix} needs: pip install 'pm01-nav[viz]'") from error
    first = next(frames)
    height, width = first.shape[:2]
    if height % 2 or width % 2:
        raise InputError(f"an .mp4 needs an even width and height; the frames are {width}x{height}")
    encoder = imageio_ffmpeg.write_frames(
        str(path),
        (width, height),
        fps=fps,  # type: ignore[arg-type]  # the stub says int; ffmpeg takes any rate
        codec="libx264",
        pix_fmt_out="yuv420p",
        quality=None,  # type: ignore[arg-type]  # None leaves it to -crf
        macro_block_size=2,
        # The index comes first, so that a browser can begin before it has the whole file.
        output_params=["-crf", "20", "-preset", "medium", "-movflags", "+faststart"],
        ffmpeg_log_level="error",
    )
    encoder.send(None)
    try:
        for frame in chain([first], frames):
            encoder.send(frame)
    finally:
        encoder.close()


def _write_gif(frames: Iterator[Frame], path: Path, fps: float) -> None:
    """Write a .gif whose frames share one palette, so that only what moves takes space."""
    shape: tuple[int, ...] = ()
    packed: list[bytes] = []
    for frame in frames:
        shape = frame.shape
        packed.append(zlib.compress(frame.tobytes(), 1))

    def unpacked(index: int) -> Frame:
        return np.frombuffer(zlib.decompress(packed[index]), np.uint8).reshape(shape)

    chosen = np.unique(np.linspace(0, len(packed) - 1, PALETTE_FRAMES).round().astype(int))
    palette = _palette(np.concatenate([unpacked(index).reshape(-1, 3) for index in chosen]))
    pictures = (
        Image.fromarray(unpacked(index)).quantize(palette=palette, dither=Image.Dither.NONE)
        for index in range(len(packed))
    )
    # Rounding each frame's end, not each length, keeps the speed right: 30 fps is 30, 40, 30 ms.
    ends = (np.arange(len(packed) + 1) * 1000.0 / fps / GIF_TICK_MS).round().astype(int)
    durations = (np.diff(ends) * GIF_TICK_MS).tolist()
    next(pictures).save(
        path, save_all=True, append_images=pictures, duration=durations, loop=0, optimize=False
    )


def _palette(pixels: NDArray[np.uint8]) -> Image.Image:
    """Return a picture whose palette suits ``pixels`` (n, 3)."""
    packed = pixels.astype(np.int32) @ np.array([1 << 16, 1 << 8, 1], dtype=np.int32)
    values, counts = np.unique(packed, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    colors = np.stack([values >> 16, values >> 8 & 255, values & 255], axis=1)[order]
    exact, rest = colors[:EXACT_COLORS], colors[EXACT_COLORS:]
    if len(rest):
        # Each shade counts once: by area, the small green goal of the last frame would be lost.
        shades = Image.fromarray(rest[None].astype(np.uint8))
        mixed = shades.quantize(COLORS - len(exact), Image.Quantize.MEDIANCUT).getpalette()
        exact = np.concatenate([exact, np.reshape(mixed or [], (-1, 3))])
    palette = Image.new("P", (1, 1))
    palette.putpalette(exact.ravel().tolist())
    return palette


WRITERS: dict[str, Callable[[Iterator[Frame], Path, float], None]] = {
    ".mp4": _write_mp4,
    ".gif": _write_gif,
}
