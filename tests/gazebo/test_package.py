# SPDX-License-Identifier: Apache-2.0
"""The ROS package ``pm01_gazebo`` without ROS and Gazebo."""

from __future__ import annotations

import ast
import sys
from pathlib import Path
from typing import Literal

import pytest
import yaml
from defusedxml.ElementTree import parse
from pydantic import BaseModel, ConfigDict, TypeAdapter

from pm01_nav import __version__
from pm01_nav.worlds.sdf import read_sdf

PACKAGE = Path(__file__).resolve().parents[2] / "src" / "pm01_gazebo"
WORLDS = sorted(PACKAGE.glob("worlds/*.sdf"))
LAUNCH = PACKAGE / "launch" / "pm01_world.launch.py"
# What ros_gz_bridge converts into each other.
PAIRS = {
    "rosgraph_msgs/msg/Clock": "gz.msgs.Clock",
    "geometry_msgs/msg/Twist": "gz.msgs.Twist",
    "nav_msgs/msg/Odometry": "gz.msgs.Odometry",
    "sensor_msgs/msg/LaserScan": "gz.msgs.LaserScan",
    "sensor_msgs/msg/Imu": "gz.msgs.IMU",
    "tf2_msgs/msg/TFMessage": "gz.msgs.Pose_V",
    "sensor_msgs/msg/JointState": "gz.msgs.Model",
}


class Entry(BaseModel):
    """One topic of the bridge; every key is given, so that nothing is left to guess."""

    model_config = ConfigDict(extra="forbid")

    ros_topic_name: str
    gz_topic_name: str
    ros_type_name: str
    gz_type_name: str
    direction: Literal["GZ_TO_ROS", "ROS_TO_GZ"]


@pytest.fixture(scope="module")
def bridge() -> list[Entry]:
    content = yaml.safe_load((PACKAGE / "config" / "bridge.yaml").read_text())
    return TypeAdapter(list[Entry]).validate_python(content)


def test_the_bridge_takes_commands_and_gives_the_rest(bridge: list[Entry]) -> None:
    to_gazebo = [entry.ros_topic_name for entry in bridge if entry.direction == "ROS_TO_GZ"]
    assert to_gazebo == ["cmd_vel"]
    names = {entry.ros_topic_name for entry in bridge}
    assert names == {"clock", "cmd_vel", "odom", "scan", "imu", "tf", "joint_states"}
    assert all(PAIRS[entry.ros_type_name] == entry.gz_type_name for entry in bridge)


def test_the_bridge_uses_the_topics_of_the_robots_description(bridge: list[Entry]) -> None:
    macro = PACKAGE.parent / "pm01_description" / "urdf" / "macros" / "gazebo.xacro"
    root = parse(macro).getroot()
    topics = {
        (element.text or "").strip()
        for tag in ("topic", "odom_topic", "tf_topic")
        for element in root.iter(tag)
    }
    bridged = {entry.gz_topic_name for entry in bridge}
    assert topics <= bridged
    # The clock is Gazebo's own.
    assert bridged - topics == {"clock"}


@pytest.mark.parametrize("path", WORLDS, ids=lambda path: path.stem)
def test_worlds_can_be_read_and_driven_in(path: Path) -> None:
    world = read_sdf(path, strict=path.stem != "moving").world
    assert world.name == path.stem
    root = parse(path).getroot()
    # Whoever runs them adds the systems: those of server.config would not be loaded beside others.
    assert root.findall("world/plugin") == []
    assert root.findtext("world/physics/max_step_size") == "0.004"
    # The robot, 0.17 m around the origin, starts in free space.
    x, y, radius = world.discs.T if len(world.discs) else ([], [], [])
    assert all(a * a + b * b > (r + 0.3) ** 2 for a, b, r in zip(x, y, radius, strict=True))


def test_moving_obstacles_go_round_at_walking_pace() -> None:
    root = parse(PACKAGE / "worlds" / "moving.sdf").getroot()
    carousels = [m for m in root.iter("model") if (m.get("name") or "").startswith("carousel")]
    assert len(carousels) == 3
    for model in carousels:
        arm = float((model.findtext("link/pose") or "").split()[0])
        turn = float(model.findtext("plugin/initial_velocity") or "")
        assert abs(arm * turn) == pytest.approx(0.3, abs=1e-3)
        # The axle stands where the arm begins.
        assert float((model.findtext("joint/pose") or "").split()[0]) == -arm


def test_systems_of_worlds_that_name_none() -> None:
    plugins = parse(PACKAGE / "config" / "server.config").getroot().findall("plugins/plugin")
    names = {(plugin.get("name") or "").rsplit("::", 1)[-1] for plugin in plugins}
    expected = {"Physics", "UserCommands", "SceneBroadcaster", "Sensors", "Imu", "Contact"}
    assert names == expected


def strings_of_calls(function: str) -> list[dict[str, str]]:
    """The keyword arguments that are plain strings, of every call of a function."""
    tree = ast.parse(LAUNCH.read_text())
    calls = [n for n in ast.walk(tree) if isinstance(n, ast.Call)]
    named = [call for call in calls if getattr(call.func, "id", "") == function]
    return [
        {k.arg: k.value.value for k in call.keywords if k.arg and isinstance(k.value, ast.Constant)}
        for call in named
    ]


def test_the_launch_file_starts_only_what_package_xml_names() -> None:
    named = {e.text for e in parse(PACKAGE / "package.xml").getroot().iter("exec_depend")}
    nodes = strings_of_calls("Node")
    assert [(node["package"], node["executable"]) for node in nodes] == [
        ("robot_state_publisher", "robot_state_publisher"),
        ("ros_gz_sim", "create"),
        ("ros_gz_bridge", "parameter_bridge"),
    ]
    assert {node["package"] for node in nodes} <= named
    imported = {
        node.module.split(".")[0]
        for node in ast.walk(ast.parse(LAUNCH.read_text()))
        if isinstance(node, ast.ImportFrom) and node.module
    }
    assert imported - set(sys.stdlib_module_names) <= named
    assert {"xacro", "pm01_description"} <= named


def test_the_launch_file_declares_its_arguments() -> None:
    tree = ast.parse(LAUNCH.read_text())
    (arguments,) = [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "arguments"
    ]
    assert isinstance(arguments, ast.Dict)
    names = [key.value for key in arguments.keys if isinstance(key, ast.Constant)]
    assert names == ["world", "headless", "robot", "x", "y", "yaw", "use_sim_time"]


def test_versions_agree() -> None:
    assert parse(PACKAGE / "package.xml").getroot().findtext("version") == __version__
