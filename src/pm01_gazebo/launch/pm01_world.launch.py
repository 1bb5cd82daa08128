# SPDX-License-Identifier: Apache-2.0
"""Put PM01 into a world of Gazebo: ros2 launch pm01_gazebo pm01_world.launch.py world:=article."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    ExecuteProcess,
    OpaqueFunction,
    SetEnvironmentVariable,
    Shutdown,
)
from launch.substitutions import Command, LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

SHARE = Path(get_package_share_directory("pm01_gazebo"))
DESCRIPTION = Path(get_package_share_directory("pm01_description"))


def generate_launch_description() -> LaunchDescription:
    """Start Gazebo's server, spawn the robot, and bridge its topics."""
    worlds = ", ".join(sorted(path.stem for path in (SHARE / "worlds").glob("*.sdf")))
    arguments = {
        "world": ("article", f"One of {worlds}, or the path of an SDF file."),
        "headless": ("false", "Without a window: the server alone, sensors drawn off screen."),
        "robot": (
            str(DESCRIPTION / "urdf" / "pm01.urdf.xacro"),
            "A robot's xacro or URDF file with Gazebo's tags.",
        ),
        "x": ("0.0", "Where the robot starts [m]."),
        "y": ("0.0", "Where the robot starts [m]."),
        "yaw": ("0.0", "Where the robot looks at the start [rad]."),
        "use_sim_time": ("true", "Time comes from /clock."),
    }
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in arguments.items()
    ]
    # Worlds that name no systems get those of this file.
    systems = SetEnvironmentVariable(
        "GZ_SIM_SERVER_CONFIG_PATH", str(SHARE / "config" / "server.config")
    )
    return LaunchDescription(
        [*declared, systems, OpaqueFunction(function=_start_gazebo), *_robot()]
    )


def _start_gazebo(context: LaunchContext) -> list[ExecuteProcess]:
    """Run the world at once, with or without a window; all ends with it."""
    world = _find(LaunchConfiguration("world").perform(context))
    headless = LaunchConfiguration("headless").perform(context).lower() in ("true", "1")
    how = ["-s", "--headless-rendering"] if headless else []
    command = ["gz", "sim", "-r", *how, str(world)]
    return [ExecuteProcess(cmd=command, output="screen", on_exit=Shutdown())]


def _find(world: str) -> Path:
    """Return the file of a world by its name or path."""
    for path in (SHARE / "worlds" / f"{world}.sdf", Path(world).expanduser()):
        if path.is_file():
            return path
    known = ", ".join(sorted(path.stem for path in (SHARE / "worlds").glob("*.sdf")))
    raise RuntimeError(
        f"world:={world}: no such file; give one of {known}, or a path, for example of "
        "pm01 worlds export static --format sdf -o my_world.sdf"
    )


def _robot() -> list[Node]:
    """Return what describes the robot, spawns it and bridges its topics."""
    use_sim_time = {
        "use_sim_time": ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)
    }
    urdf = Command(["xacro ", LaunchConfiguration("robot"), " gazebo:=harmonic"])
    place = [
        word
        for flag, name in (("-x", "x"), ("-y", "y"), ("-Y", "yaw"))
        for word in (flag, LaunchConfiguration(name))
    ]
    return [
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            parameters=[
                {"robot_description": ParameterValue(urdf, value_type=str)},
                use_sim_time,
            ],
        ),
        Node(
            package="ros_gz_sim",
            executable="create",
            arguments=["-topic", "robot_description", "-name", "pm01", *place, "-z", "0.001"],
            output="screen",
        ),
        Node(
            package="ros_gz_bridge",
            executable="parameter_bridge",
            parameters=[{"config_file": str(SHARE / "config" / "bridge.yaml")}, use_sim_time],
            output="screen",
        ),
    ]
