# SPDX-License-Identifier: Apache-2.0
"""Pictures, videos, the window and the training plot.

The pictures are 720 px high and show a world of 10 m x 10 m. Of the height, a margin of 16 px at
the top and bottom and 32 px for the caption are not the world's, which leaves 656 px: 65.6 px/m.
So the picture is 656 + 2 * 16 = 688 px wide, and a point (x, y) [m] lies in column 16 + 65.6 x
and row 16 + 65.6 (10 - y).
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pygame
import pytest
from numpy.typing import NDArray
from PIL import Image

from pm01_nav.errors import InputError
from pm01_nav.geometry import rectangle
from pm01_nav.rendering import canvas
from pm01_nav.rendering.canvas import Canvas
from pm01_nav.rendering.scene import Scene, fit, picture_size
from pm01_nav.rendering.training_plot import _with_last, plot_training
from pm01_nav.rendering.video import write_video
from pm01_nav.rendering.window import Window
from pm01_nav.robot import load_robot
from pm01_nav.worlds.world import OccupancyGrid, World

BOUNDS = (0.0, 0.0, 10.0, 10.0)
WORLD = World(
    name="room",
    bounds=BOUNDS,
    discs=np.array([[2.0, 8.0, 0.8]]),
    polygons=(rectangle(8.0, 8.0, 1.0, 1.0),),
    segments=np.array([[1.0, 5.0, 4.0, 5.0]]),
)
SCENE = Scene(pose=np.array([5.0, 2.0, 0.0]), goal=np.array([8.0, 3.0]), goal_radius=0.5)


def pixel(picture: NDArray[np.uint8], x: float, y: float) -> tuple[int, ...]:
    """Return the colour at a point of the 10 m world [m]."""
    return tuple(picture[int(16 + 65.6 * (10 - y)), int(16 + 65.6 * x)].tolist())


def draw(scene: Scene = SCENE, world: World = WORLD, robot: str = "pm01") -> NDArray[np.uint8]:
    """Draw one picture of a 10 m world."""
    return Canvas(world, load_robot(robot)).draw(scene)


def moving_square(num_frames: int) -> Iterator[NDArray[np.uint8]]:
    """Yield frames of 64 x 48 with a red square 4 px further right in each."""
    for index in range(num_frames):
        frame = np.full((48, 64, 3), 255, dtype=np.uint8)
        frame[16:32, 4 * index : 4 * index + 16] = (200, 30, 30)
        yield frame


def on_screen(x: int, y: int) -> tuple[int, ...]:
    """Return the colour of a pixel in the window."""
    screen = pygame.display.get_surface()
    assert screen is not None
    return tuple(screen.get_at((x, y)))[:3]


def test_obstacles_are_where_they_stand_and_y_is_up() -> None:
    picture = draw()
    assert picture.dtype == np.uint8
    assert picture.shape == (720, 688, 3)
    assert pixel(picture, 2.0, 8.0) == canvas.OBSTACLE
    assert pixel(picture, 8.0, 8.0) == canvas.OBSTACLE
    assert pixel(picture, 2.5, 5.0) == canvas.WALL
    # The disc's radius is 0.8 m, of which the edge takes 1.5 px = 0.023 m.
    assert pixel(picture, 2.0 + 0.74, 8.0) == canvas.OBSTACLE
    assert pixel(picture, 2.0 + 0.9, 8.0) != canvas.OBSTACLE
    # Mirrored, the disc and the box would be at the bottom.
    assert pixel(picture, 2.2, 1.8) == canvas.FLOOR
    assert pixel(picture, 8.2, 1.8) == canvas.FLOOR


def test_movers_are_discs_where_they_are_now() -> None:
    picture = draw(replace(SCENE, movers=np.array([[3.0, 3.0, 0.5], [6.0, 6.0, 0.25]])))
    assert pixel(picture, 3.0, 3.0) == canvas.MOVER
    assert pixel(picture, 6.0, 6.0) == canvas.MOVER
    # Inside the edge of 1.5 px = 0.023 m, and outside.
    assert pixel(picture, 3.0 + 0.45, 3.0) == canvas.MOVER
    assert pixel(picture, 3.0 + 0.6, 3.3) == canvas.FLOOR


def test_goal_is_a_target_of_its_radius() -> None:
    picture = draw()
    assert pixel(picture, 8.0, 3.0) == canvas.GOAL
    # The ring lies inside the radius and is 2 px = 0.03 m wide.
    assert pixel(picture, 8.0 + 0.485, 3.0) == canvas.GOAL
    assert pixel(picture, 8.0 + 0.56, 3.2) == canvas.FLOOR


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, np.pi, -np.pi / 2])
def test_robot_is_at_its_pose_and_its_mark_points_ahead(yaw: float) -> None:
    picture = draw(replace(SCENE, pose=np.array([5.0, 2.0, yaw])))
    ahead = 0.4 * 0.17 * np.array([np.cos(yaw), np.sin(yaw)])
    assert pixel(picture, *(np.array([5.0, 2.0]) + ahead)) == canvas.WHITE
    # Behind the mark's notch (0.25 radii back) the body is seen.
    assert pixel(picture, *(np.array([5.0, 2.0]) - ahead)) == canvas.ROBOT


def test_polygon_robot_is_drawn_turned() -> None:
    picture = draw(replace(SCENE, pose=np.array([5.0, 2.0, np.pi / 4])), robot="jackal")
    # The front left corner, (0.229, 0.208) in base_link, points along (0.015, 0.309) at 45 deg.
    assert pixel(picture, 5.0 + 0.8 * 0.015, 2.0 + 0.8 * 0.309) == canvas.ROBOT


def test_returns_have_dots_and_lost_beams_none() -> None:
    robot = load_robot("pm01")
    scan = np.full(robot.lidar.num_beams, np.inf)
    # pm01 has a beam a degree from -180 deg on: beam 180 looks ahead, beam 270 to the left.
    scan[180], scan[270] = 2.0, 1.5
    picture = draw(replace(SCENE, scan=scan))
    assert pixel(picture, 7.0, 2.0) == canvas.LIDAR
    assert pixel(picture, 5.0, 3.5) == canvas.LIDAR
    assert (picture == canvas.LIDAR).all(axis=-1).sum() < 30


def test_trail_fades_with_age() -> None:
    way = np.stack([np.linspace(1.0, 5.0, 200), np.full(200, 2.0)], axis=1)
    picture = draw(replace(SCENE, trail=way)).astype(int)
    old, new = np.array(pixel(picture, 1.2, 2.0)), np.array(pixel(picture, 4.6, 2.0))
    # Blue is what white has and orange lacks.
    assert 255 > old[2] > new[2] + 50


def test_outcome_shows() -> None:
    drawer = Canvas(WORLD, load_robot("pm01"))
    running = drawer.draw(SCENE)
    success = drawer.draw(replace(SCENE, outcome="success"))
    assert pixel(success, 8.0, 3.0) == canvas.SUCCESS
    collision = drawer.draw(replace(SCENE, outcome="collision"))
    assert pixel(collision, 5.0 - 0.068, 2.0) == canvas.COLLISION
    assert (success[-32:] == canvas.SUCCESS).all(axis=-1).any()
    assert (collision[-32:] == canvas.COLLISION).all(axis=-1).any()
    # Nothing of a frame stays for the next one.
    assert (running == drawer.draw(SCENE)).all()


def test_caption_stays_in_its_strip() -> None:
    silent, loud = draw(), draw(replace(SCENE, caption="W" * 500))
    assert (silent[:688] == loud[:688]).all()
    assert (silent[688:] != loud[688:]).any()
    assert (loud[688:, -16:] == canvas.PAGE).all()


def test_grid_cells_are_where_they_stand() -> None:
    occupied = np.zeros((4, 8), dtype=np.uint8)
    # Row 0 is the lowest: this cell spans x 3..4 and y 2..3 with an origin at (2, 1).
    occupied[1, 1] = 1
    picture = draw(world=World("map", BOUNDS, grid=OccupancyGrid(occupied, 1.0, (2.0, 1.0))))
    for x, y in ((3.04, 2.04), (3.96, 2.96), (3.5, 2.5)):
        assert pixel(picture, x, y) == canvas.OBSTACLE_EDGE
    for x, y in ((2.8, 2.5), (3.5, 3.2), (4.3, 2.5), (3.5, 1.5), (3.5, 4.5)):
        assert pixel(picture, x, y) != canvas.OBSTACLE_EDGE


def test_turned_cells_are_where_they_stand() -> None:
    # A cell of 1 m at the end of a row of three, turned left by 90 degrees about (6, 2): it spans
    # x 5 to 6 and y 4 to 5.
    row = np.array([[0, 0, 1]], dtype=np.uint8)
    grid = OccupancyGrid(row, 1.0, (6.0, 2.0), np.pi / 2)
    picture = draw(world=World("map", BOUNDS, grid=grid))
    for x, y in ((5.04, 4.04), (5.96, 4.96), (5.5, 4.5)):
        assert pixel(picture, x, y) == canvas.OBSTACLE_EDGE
    for x, y in ((4.8, 4.5), (6.2, 4.5), (5.5, 3.7), (5.5, 5.2), (6.5, 2.5)):
        assert pixel(picture, x, y) != canvas.OBSTACLE_EDGE


def test_map_is_shown_as_far_as_it_is_free_and_is_solid_beyond() -> None:
    # 9 m x 9 m of free cells in 200 m of nothing: with half a metre around that is the 10 m world.
    cells = np.ones((2000, 2000), dtype=np.uint8)
    cells[1000:1090, 1000:1090] = 0
    cells[1040, 1000:1090] = 1
    grid = OccupancyGrid(cells, 0.1, (-99.5, -99.5), closed=True)
    picture = draw(world=World("map", grid.extent(), grid=grid))
    assert picture.shape == (720, 688, 3)
    # One row of cells, 6.6 px high, from y = 4.5 m on.
    for x, y in ((0.25, 5.0), (9.8, 5.0), (5.0, 0.2), (5.0, 9.8), (5.0, 4.55)):
        assert pixel(picture, x, y) == canvas.OBSTACLE_EDGE
    for x, y in ((0.8, 5.0), (9.2, 5.0), (5.0, 0.8), (5.0, 9.2)):
        assert pixel(picture, x, y) != canvas.OBSTACLE_EDGE
    assert (picture[704:] == canvas.PAGE).all()


def test_no_wall_of_a_fine_map_is_lost() -> None:
    # Cells of 5 mm, a dozen to a pixel of the picture before it is reduced.
    cells = np.zeros((2000, 2000), dtype=np.uint8)
    cells[1000] = 1
    picture = draw(world=World("map", BOUNDS, grid=OccupancyGrid(cells, 0.005, (0.0, 0.0))))
    column = picture[300:400, 100].sum(axis=1)
    assert column.min() < 0.9 * np.median(column)


def test_view_keeps_scales_equal_and_centres() -> None:
    # 4 m x 2 m in 720 x 720: 688 px / 4 m = 172 px/m, as 656 px / 2 m would be more.
    view = fit((1.0, 1.0, 5.0, 3.0), (720, 720))
    assert view.scale == pytest.approx(172.0)
    # The middle of the world is in the middle of the 688 rows above the caption.
    assert view.pixels([3.0, 2.0]) == pytest.approx(np.array([360.0, 16 + 656 / 2]))
    assert view.pixels([1.0, 3.0]) == pytest.approx(np.array([16.0, 344 - 172]))


def test_picture_size_follows_the_world() -> None:
    # 656 px of height are left for 13 m: 50.46 px/m, so 4.5 m need 227 px and two margins of 16.
    assert picture_size((-4.5, 0.0, 0.0, 13.0)) == (260, 720)
    # 688 px for 20 m: 34.4 px/m, so 10 m need 344 px, two margins and the caption: 408.
    assert picture_size((0.0, 0.0, 20.0, 10.0)) == (720, 408)
    # Not thinner than a quarter.
    assert picture_size((0.0, 0.0, 1.0, 100.0)) == (180, 720)


@pytest.mark.parametrize("size", [(64, 64), (101, 333), (1280, 720)])
@pytest.mark.parametrize("num_points", [0, 1, 2])
def test_unusual_sizes_trails_and_ranges_are_drawn(size: tuple[int, int], num_points: int) -> None:
    scan = np.repeat([np.nan, -np.inf, np.inf, 1.0], 90)
    scene = replace(
        SCENE, caption="cap", outcome="timeout", scan=scan, trail=np.ones((num_points, 2))
    )
    picture = Canvas(WORLD, load_robot("pm01"), size).draw(scene)
    assert picture.shape == (size[1], size[0], 3)


def test_mp4_decodes_to_what_was_written(tmp_path: Path) -> None:
    path = tmp_path / "new" / "drive.mp4"
    write_video(moving_square(12), path, fps=10)
    frames = iio.imread(path, plugin="FFMPEG")
    assert frames.shape == (12, 48, 64, 3)
    # H.264 is lossy: in the middle of the square it is some levels off.
    assert np.abs(frames[11, 24, 44 + 8].astype(int) - (200, 30, 30)).max() < 25
    assert iio.immeta(path, plugin="FFMPEG")["fps"] == pytest.approx(10.0)
    assert os.listdir(path.parent) == ["drive.mp4"]


def test_gif_decodes_to_what_was_written(tmp_path: Path) -> None:
    path = tmp_path / "drive.gif"
    write_video(moving_square(12), path, fps=30)
    with Image.open(path) as gif:
        assert gif.size == (64, 48)
        duration = 0
        for index in range(12):
            gif.seek(index)
            duration += gif.info["duration"]
            assert gif.convert("RGB").getpixel((4 * index + 8, 24)) == (200, 30, 30)
        with pytest.raises(EOFError):
            gif.seek(12)
    assert duration == 400  # 12 frames at 30 fps
    assert os.listdir(tmp_path) == ["drive.gif"]


@pytest.mark.parametrize("name", ["drive.mp4", "drive.gif"])
def test_failing_frames_leave_no_file_and_an_old_one_alone(tmp_path: Path, name: str) -> None:
    def failing() -> Iterator[NDArray[np.uint8]]:
        yield from moving_square(3)
        raise RuntimeError("the simulator broke")

    (tmp_path / f"old_{name}").write_bytes(b"yesterday's")
    for target in (name, f"old_{name}"):
        with pytest.raises(RuntimeError, match="the simulator broke"):
            write_video(failing(), tmp_path / target, fps=10)
    assert os.listdir(tmp_path) == [f"old_{name}"]
    assert (tmp_path / f"old_{name}").read_bytes() == b"yesterday's"


def test_unusable_videos_are_refused_in_one_line(tmp_path: Path) -> None:
    odd = np.zeros((49, 64, 3), dtype=np.uint8)
    cases = (
        ("drive.avi", moving_square(2), 10.0, "allowed: .mp4, .gif"),
        ("drive.gif", moving_square(2), 0.0, "fps = 0"),
        ("drive.gif", iter(()), 10.0, "no frames"),
        ("drive.mp4", iter(()), 10.0, "no frames"),
        ("drive.mp4", iter([odd]), 10.0, "even"),
        ("drive.gif", iter([odd, odd[:48]]), 10.0, "instead of"),
    )
    for name, frames, fps, message in cases:
        with pytest.raises(InputError, match=rf"\A[^\n]*{message}[^\n]*\Z"):
            write_video(frames, tmp_path / name, fps)
    assert os.listdir(tmp_path) == []


def test_missing_packages_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("imageio_ffmpeg", "pygame", "matplotlib"):
        monkeypatch.setitem(sys.modules, module, None)
    for use in (
        lambda: write_video(moving_square(2), tmp_path / "drive.mp4", 10),
        Window,
        lambda: plot_training({}, tmp_path / "plot.png", "a run"),
    ):
        with pytest.raises(InputError, match=r"pm01-nav\[viz\]"):
            use()
    assert os.listdir(tmp_path) == []


def test_window_shows_resizes_and_closes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    window = Window()
    frame = np.full((48, 64, 3), (10, 200, 30), dtype=np.uint8)
    frame[:24] = (200, 0, 0)
    assert window.show(frame, fps=1000)
    assert pygame.display.get_window_size() == (64, 48)
    assert on_screen(60, 5) == (200, 0, 0)
    assert on_screen(5, 40) == (10, 200, 30)
    pygame.display.set_mode((200, 96), pygame.RESIZABLE)
    assert window.show(frame)
    # Twice as large and centred: 128 of 200 columns, so 36 are left on either side.
    assert on_screen(30, 50) == (238, 241, 245)
    assert on_screen(40, 80) == (10, 200, 30)
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    assert not window.show(frame)
    assert not window.is_open
    window.close()
    assert not window.show(frame)


@pytest.mark.parametrize("num_points", [0, 1, 2, 100])
@pytest.mark.filterwarnings("error")
def test_training_plot_is_written_for_any_length(tmp_path: Path, num_points: int) -> None:
    rising = np.linspace(0.0, 1.0, num_points).tolist()
    keys = ("seconds", "steps", "collision_rate", "timeout_rate", "return", "reward/goal")
    evaluations = ("seconds", "success_rate", "success_low", "success_high")
    history = {key: rising for key in keys} | {f"eval_{key}": rising[::10] for key in evaluations}
    # In the first iteration no episode has ended.
    history["success_rate"] = [float("nan"), *rising[1:]][:num_points]
    plot_training(history, tmp_path / "runs" / "training.png", "a run")
    with Image.open(tmp_path / "runs" / "training.png") as picture:
        assert picture.format == "PNG"
        assert np.array(picture.convert("L")).std() > 5.0
    assert os.listdir(tmp_path / "runs") == ["training.png"]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("names", [("stage", "effective_worlds"), ("learnability",)])
def test_curriculum_has_a_panel_only_where_there_is_one(tmp_path: Path, names) -> None:
    keys = ("seconds", "steps", "success_rate")
    history = {key: [0.0, 0.5, 1.0] for key in keys}
    curriculum = {f"curriculum/{name}": [float("nan"), 1.0, 4.0] for name in names}
    plot_training(history, tmp_path / "without.png", "a run")
    plot_training(history | curriculum, tmp_path / "with.png", "a run")
    with Image.open(tmp_path / "without.png") as less, Image.open(tmp_path / "with.png") as more:
        assert more.width == less.width
        # Panels of 1.25 + 1 + 1.25 = 3.5 parts, and one of 0.8 more.
        assert more.height == pytest.approx(less.height * 4.3 / 3.5, abs=2)


@pytest.mark.parametrize(
    ("values", "expected"),
    [([50.0, -1e-9], "x: 0.0 %"), ([99.96, np.nan], "x: 100.0 %"), ([np.nan], "x")],
)
def test_a_line_is_named_with_its_last_value(values: list[float], expected: str) -> None:
    assert _with_last("x", np.array(values)) == expected
