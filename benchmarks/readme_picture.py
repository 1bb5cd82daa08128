# SPDX-License-Identifier: Apache-2.0
"""The README's first picture: policies of the zoo in a BARN world and in a crowd, side by side.

python benchmarks/readme_picture.py --worlds BARN --out docs/images/zoo.gif
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from itertools import zip_longest
from pathlib import Path

import numpy as np
from PIL import Image, ImageSequence

from pm01_nav.rendering.video import Frame, write_video

PM01 = str(Path(sys.executable).with_name("pm01"))
HEIGHT = 460
"""Of the picture [pixels]."""
SHOWN = 0.945
"""Of a frame's height; below are its captions."""
BARN_PART = (0.27, 0.73)
"""A BARN world is narrow: so much of a frame's width shows it."""
FRAMES_PER_SECOND = 10.0
EVERY = 2
"""Of `pm01 replay`'s frames every second one is taken."""


def film(policy: str, *options: str, part: tuple[float, float] = (0.0, 1.0)) -> list[Frame]:
    """Return the frames of `pm01 replay`'s first episode, or a part of their width."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "episode.gif"
        command = [PM01, "replay", policy, *options, "--episodes", "1", "-o", str(path)]
        subprocess.run(command, check=True)
        with Image.open(path) as film:
            frames = [frame.convert("RGB") for frame in ImageSequence.Iterator(film)][::EVERY]
    width, height = frames[0].width, SHOWN * frames[0].height
    box = (part[0] * width, 0, part[1] * width, height)
    size = (round((box[2] - box[0]) * HEIGHT / height), HEIGHT)
    return [np.asarray(f.resize(size, Image.Resampling.LANCZOS, box)) for f in frames]


def one_world(worlds: Path, index: int, folder: Path) -> Path:
    """Return a folder that holds one of the BARN worlds."""
    (folder / "path_files").mkdir()
    for name in (f"world_{index}.world", f"path_files/path_{index}.npy"):
        (found,) = worlds.rglob(name)
        shutil.copyfile(found, folder / name)
    return folder


def beside(left: list[Frame], right: list[Frame]) -> list[Frame]:
    """Return frames of both; the shorter film waits at its end."""
    pairs = zip_longest(left, right)
    return [
        np.hstack([left[-1] if a is None else a, right[-1] if b is None else b]) for a, b in pairs
    ]


def main() -> None:
    """Film both and write one picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", type=Path, required=True, help="the unpacked BARN dataset")
    parser.add_argument("--barn-world", type=int, default=260)
    parser.add_argument("--crowd-policy", default="zoo:pm01-crowd")
    parser.add_argument("--crowd-seed", default="3")
    parser.add_argument("--out", required=True)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = one_world(options.worlds, options.barn_world, Path(name))
        worlds = ("--task", "barn", "--worlds", str(folder))
        barn = film("zoo:jackal-barn", *worlds, part=BARN_PART)
    crowd = film(
        options.crowd_policy,
        *("--task", "crowd", "--set", "task.suite_params={pedestrians: 20}"),
        *("--seed", options.crowd_seed),
    )
    write_video(beside(barn, crowd), options.out, FRAMES_PER_SECOND)


if __name__ == "__main__":
    main()
