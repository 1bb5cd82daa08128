# SPDX-License-Identifier: Apache-2.0
"""``pm01 robots``: show, new and import."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from PIL import Image

from pm01_nav.cli.robots import command
from pm01_nav.errors import InputError
from pm01_nav.robot import load_robot, robot_names

URDF = """<robot name="bot"><link name="base_link"><collision><geometry>
<box size="0.3 0.2 0.1"/></geometry></collision></link>{}</robot>"""
WHEEL = """<link name="{0}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>
<collision><geometry><sphere radius="0.05"/></geometry></collision></link><joint name="{0}_joint"
type="continuous"><parent link="base_link"/><child link="{0}"/><origin xyz="0 {1} 0"/>
<axis xyz="0 1 0"/></joint>"""
WHEELS = WHEEL.format("left", 0.1) + WHEEL.format("right", -0.1)


def run(*arguments: str) -> Result:
    done = CliRunner().invoke(command, list(arguments))
    if isinstance(done.exception, InputError):
        raise done.exception
    assert done.exit_code == 0, done.output
    return done


@pytest.mark.parametrize("name", robot_names())
def test_show_prints_and_draws(tmp_path: Path, name: str) -> None:
    picture = tmp_path / "robot.png"
    output = run("show", name, "-o", str(picture)).output
    robot = load_robot(name)
    assert robot.description in output
    for figure in (
        f"{robot.limits.linear_max:g} m/s",
        f"{robot.limits.angular_max:g} rad/s",
        f"{robot.wheels.separation:g} m",
        f"{robot.lidar.range_max:g} m",
        str(robot.lidar.num_beams),
    ):
        assert figure in output
    with Image.open(picture) as image:
        assert image.size == (640, 704)
    assert picture.stat().st_size < 60_000


def test_new_loads_and_is_not_written_over(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    assert run("new", str(path)).output == f"wrote {path}\n"
    assert load_robot(path).name == "mine"
    path.write_text("mine: own\n")
    with pytest.raises(InputError, match=r"mine\.yaml: exists already; --force writes over it"):
        run("new", str(path))
    assert path.read_text() == "mine: own\n"
    run("new", str(path), "--force")
    assert load_robot(path).name == "mine"


def test_import_writes_what_loads(tmp_path: Path) -> None:
    source, target = tmp_path / "bot.urdf", tmp_path / "bot.yaml"
    source.write_text(URDF.format(WHEELS))
    done = run("import", str(source), "-o", str(target))
    assert f"wrote {target}\n" in done.stdout
    assert "warning: no lidar found" in done.stderr
    assert load_robot(target).wheels.separation == 0.2
    with pytest.raises(InputError, match="exists already"):
        run("import", str(source), "-o", str(target))
    options = ("--wheel-radius", "0.06", "--footprint-radius", "0.2", "--force")
    run("import", str(source), "-o", str(target), "--wheels", "right_joint", "left_joint", *options)
    robot = load_robot(target)
    assert (robot.wheels.radius, robot.footprint.radius) == (0.06, 0.2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["show", "r2d2"], "robot = 'r2d2': unknown; allowed: jackal, pm01, turtlebot3_burger"),
        (["show", "none.yaml"], "none.yaml: cannot be read"),
        (["show", "bad.yaml"], "bad.yaml: footprint.* with the origin inside"),
        (["show", "pm01", "-o", "robot.gif"], "output = robot.gif: unknown suffix"),
        (["show", "pm01", "-o", "no/robot.png"], "its folder does not exist"),
        (["new", "robot.txt"], r"robot.txt: a robot's file must be named \*.yaml"),
        (["new", "no/robot.yaml"], "no/robot.yaml: its folder does not exist"),
        (["import", "none.urdf", "-o", "a.yaml"], "none.urdf: cannot be read"),
        (["import", "bot.urdf", "-o", "a.yaml"], "bot.urdf: has no two driven wheels"),
        (["import", "good.urdf", "-o", "a.urdf"], r"a.urdf: a robot's file must be named \*.yaml"),
    ],
)
def test_wrong_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bot.urdf").write_text(URDF.format(""))
    Path("good.urdf").write_text(URDF.format(WHEELS))
    run("new", "bad.yaml")
    text = Path("bad.yaml").read_text().replace("-0.25", "0.15")
    Path("bad.yaml").write_text(text)
    with pytest.raises(InputError, match=message) as error:
        run(*arguments)
    assert "\n" not in str(error.value)
    assert not Path("a.yaml").exists()
