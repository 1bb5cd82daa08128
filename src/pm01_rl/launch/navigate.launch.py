# SPDX-License-Identifier: Apache-2.0
"""Drive a robot by a policy: ros2 launch pm01_rl navigate.launch.py policy:=policy.onnx."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "policy": (None, "The policy's file, policy.onnx."),
    "robot": ("", "A robot's name or YAML; empty: the policy's own, and pm01 for a simulated one."),
    "use_sim_time": ("false", "Time comes from /clock."),
    "cmd_vel_stamped": ("false", "Commands are TwistStamped, not Twist."),
    "autostart": ("true", "Configure and activate the policy node at once."),
    "simulate": ("false", "Start a simulated robot, too."),
    "world": ("static", "Where the simulated robot is: a suite, or a world's file."),
    "seed": ("0", "Chooses the simulated robot's world, start and goal."),
    "real_time_factor": ("1.0", "How fast the simulated robot's time runs."),
}
TYPES = {
    "use_sim_time": bool,
    "cmd_vel_stamped": bool,
    "autostart": bool,
    "seed": int,
    "real_time_factor": float,
}


def node(executable: str, arguments: list[str], **options: object) -> Node:
    """Return one of our nodes, with launch arguments as its parameters of the same names."""
    parameters = {
        name: ParameterValue(LaunchConfiguration(name), value_type=TYPES.get(name, str))
        for name in arguments
    }
    return Node(
        package="pm01_rl",
        executable=executable,
        name=executable,
        output="screen",
        parameters=[parameters],
        **options,
    )


def generate_launch_description() -> LaunchDescription:
    """Start the policy node, a watchdog between it and the base, and a simulated robot if asked."""
    base = ["use_sim_time", "cmd_vel_stamped"]
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in ARGUMENTS.items()
            ),
            node(
                "policy_node",
                ["policy", "robot", "autostart", *base],
                remappings=[("cmd_vel", "cmd_vel_in")],
            ),
            node("watchdog_node", base),
            node(
                "sim_node",
                ["robot", "cmd_vel_stamped", "world", "seed", "real_time_factor"],
                condition=IfCondition(LaunchConfiguration("simulate")),
            ),
        ]
    )
