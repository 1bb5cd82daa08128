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
        *([f"{robot.wheels.separation:g} m"] if robot.wheels else []),
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


def test_show_says_where_figures_came_from_and_what_was_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "160")
    source, target = tmp_path / "bot.urdf", tmp_path / "bot.yaml"
    sonar = """<gazebo reference="base_link"><sensor name="sonar" type="ray"><ray><scan><horizontal>
        <samples>5</samples></horizontal></scan></ray></sensor></gazebo>"""
    source.write_text(URDF.format(WHEELS + sonar))
    run("import", str(source), "-o", str(target))
    output = run("show", str(target)).output
    rows = {
        line.split("\u2502")[1].strip(): line for line in output.splitlines() if "\u2502" in line
    }
    assert "left, sphere of its collision" in rows["wheel radius"]
    assert "hull of the collision shapes" in rows["footprint"]
    assert "default: not in the URDF; check it" in rows["turn rate"]
    assert "sensor 'sonar': left out; a range sensor of 5 beams" in output
    # Comments that a person wrote count as well, wherever YAML lets them stand.
    text = target.read_text().replace("  radius: 0.05", "  radius: 0.05 # callipers\n  # and more")
    target.write_text(text.replace("# left, sphere", "# was left, sphere"))
    assert "callipers" in run("show", str(target)).output


def test_import_takes_a_xacro_file_with_its_arguments(tmp_path: Path) -> None:
    pytest.importorskip("xacro", reason="needs xacro (extra dev)")
    source, target = tmp_path / "bot.xacro", tmp_path / "bot.yaml"
    head = '<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arg name="name" default="a"/>'
    text = (
        URDF.format(WHEELS)
        .replace('<robot name="bot">', head)
        .replace('size="0.3', 'size="$(arg length)')
    )
    source.write_text(text)
    run("import", str(source), "length:=0.5", "-o", str(target), "--packages", str(tmp_path))
    assert max(x for x, _ in load_robot(target).footprint.vertices) == 0.25


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["show", "r2d2"],
            "robot = 'r2d2': unknown; allowed: jackal, omni_disc, pm01, turtlebot3_burger",
        ),
        (["show", "none.yaml"], "none.yaml: cannot be read"),
        (["show", "bad.yaml"], "bad.yaml: footprint.* with the origin inside"),
        (["show", "pm01", "-o", "robot.gif"], "output = robot.gif: unknown suffix"),
        (["show", "pm01", "-o", "no/robot.png"], "its folder does not exist"),
        (["new", "robot.txt"], r"robot.txt: a robot's file must be named \*.yaml"),
        (["new", "no/robot.yaml"], "no/robot.yaml: its folder does not exist"),
        (["import", "none.urdf", "-o", "a.yaml"], "none.urdf: cannot be read"),
        (["import", "bot.urdf", "-o", "a.yaml"], "bot.urdf: has no two driven wheels"),
        (["import", "good.urdf", "length=1", "-o", "a.yaml"], "length=1: .*given as NAME:=VALUE"),
        (["import", "good.urdf", "-o", "a.yaml", "--lidar", "x"], "--lidar 'x': no such sensor"),
        (["import", "good.urdf", "-o", "a.yaml", "--without", "x"], "--without 'x': no such link"),
        (
            ["import", "good.urdf", "-o", "a.yaml", "--packages", "x"],
            "--packages x: no such folder",
        ),
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
