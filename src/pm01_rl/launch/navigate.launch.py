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
    "exclusive": ("false", "Stand while somebody else publishes commands, too."),
    "yaw_goal_tolerance": ("0.25", "Near enough to a goal's heading [rad]; pi: any will do."),
    "goal_patience_s": ("10.0", "After so long of standing a goal is given up [s]."),
    "scan": ("scan", "The lidar's topic."),
    "odom": ("odom", "Odometry's topic."),
    "cmd_vel": ("cmd_vel", "Where commands go: the base, or the next node before it."),
    "goal_pose": ("goal_pose", "The topic of RViz's button."),
    "navigate_to_pose": ("navigate_to_pose", "The action's name; Nav2 has one of this name, too."),
    "navigate_through_poses": ("navigate_through_poses", "As above."),
    "simulate": ("false", "Start a simulated robot, too."),
    "world": ("static", "Where the simulated robot is: a suite, or a world's file."),
    "seed": ("0", "Chooses the simulated robot's world, start and goal."),
    "real_time_factor": ("1.0", "How fast the simulated robot's time runs."),
}
TYPES = {
    "use_sim_time": bool,
    "cmd_vel_stamped": bool,
    "autostart": bool,
    "exclusive": bool,
    "yaw_goal_tolerance": float,
    "goal_patience_s": float,
    "seed": int,
    "real_time_factor": float,
}
TOPICS = ("scan", "odom", "goal_pose")
ACTIONS = ("navigate_to_pose", "navigate_through_poses")
ACTION_PARTS = ("send_goal", "cancel_goal", "get_result", "feedback", "status")
"""An action is renamed by renaming all that it is made of."""


def node(executable: str, arguments: list[str], **options: object) -> Node:
    """Return one of our nodes, with launch arguments as its parameters of the same names."""
    parameters = {
        name: ParameterValue(
            LaunchConfiguration("cmd_vel" if name == "base_topic" else name),
            value_type=TYPES.get(name, str),
        )
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


def renamed() -> list[tuple]:
    """Return the policy node's topics and actions with the names that the arguments give them."""
    topics = [(name, LaunchConfiguration(name)) for name in TOPICS]
    parts = [(name, f"/_action/{part}") for name in ACTIONS for part in ACTION_PARTS]
    return topics + [(name + part, [LaunchConfiguration(name), part]) for name, part in parts]


def generate_launch_description() -> LaunchDescription:
    """Start the policy node, a watchdog between it and the base, and a simulated robot if asked."""
    base = ["use_sim_time", "cmd_vel_stamped"]
    own = ["policy", "robot", "autostart", "exclusive", "yaw_goal_tolerance", "goal_patience_s"]
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in ARGUMENTS.items()
            ),
            # The base's topic is the watchdog's output; on it the node looks for others.
            node(
                "policy_node",
                [*own, *base, "base_topic"],
                remappings=[("cmd_vel", "cmd_vel_in"), *renamed()],
            ),
            node("watchdog_node", base, remappings=[("cmd_vel", LaunchConfiguration("cmd_vel"))]),
            node(
                "sim_node",
                ["robot", "cmd_vel_stamped", "world", "seed", "real_time_factor"],
                condition=IfCondition(LaunchConfiguration("simulate")),
            ),
        ]
    )
