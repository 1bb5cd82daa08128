# SPDX-License-Identifier: Apache-2.0
"""A simulated robot that goes sideways, and the node that tells it to."""

from __future__ import annotations

import pytest
import torch

from pm01_nav.policy.export import export_policy, policy_metadata
from pm01_nav.task.config import observation_layout
from pm01_nav.task.tasks import task_config
from pm01_nav.training.algorithms.ppo import PPOConfig
from pm01_nav.training.ppo import make_policy


@pytest.fixture
def sideways_policy(tmp_path):
    """Return a policy that goes straight to the goal at 0.4 m/s, and does not turn."""
    config = task_config("static").model_copy(update={"robot": "omni_disc"})
    robot = config.robot_spec()
    layout = observation_layout(config, robot)
    policy = make_policy(PPOConfig(net_arch=(16, 16), activation="relu"), layout)
    names = [part.name for part in layout.parts]
    sine = sum(part.size for part in layout.parts[: names.index("goal_sin_cos")])
    first, _, second, _ = policy.mlp_extractor.policy_net
    with torch.no_grad():
        for layer in (first, second, policy.action_net):
            layer.weight.zero_()
            layer.bias.zero_()
        # Forwards by the cosine, to the left by the sine, 0.8 x 0.5 m/s; what is positive and what
        # is negative of them pass the rectifiers apart.
        for axis, column in ((0, sine + 1), (1, sine)):
            for sign, unit in ((1.0, 2 * axis), (-1.0, 2 * axis + 1)):
                first.weight[unit, column] = sign
                second.weight[unit, unit] = 1.0
                policy.action_net.weight[axis, unit] = 0.8 * sign
    path = tmp_path / "policy.onnx"
    export_policy(policy, layout, policy_metadata(layout, robot, config.control_dt, {}), path)
    return path


def test_it_drives_to_a_goal_at_its_right(start, watcher, sideways_policy):
    from nav_msgs.msg import Odometry

    places, twists = [], []

    def note(message: Odometry) -> None:
        places.append(message.pose.pose)
        twists.append(message.twist.twist)

    watcher.create_subscription(Odometry, "/odom", note, 50)
    start("sim_node", world="empty", robot="omni_disc", seed=2)
    start("policy_node", policy=sideways_policy, robot="omni_disc", autostart="true")
    assert watcher.wait_for(lambda: bool(places) and bool(watcher.commands))
    start_pose = places[-1]
    cosine = 1.0 - 2.0 * start_pose.orientation.z**2
    sine = 2.0 * start_pose.orientation.w * start_pose.orientation.z
    # A metre to the right of where it looks: (sin, -cos).
    goal = (start_pose.position.x + sine, start_pose.position.y - cosine)

    def far() -> float:
        here = places[-1].position
        return ((goal[0] - here.x) ** 2 + (goal[1] - here.y) ** 2) ** 0.5

    def moves() -> bool:
        return any(message.linear.y < -0.3 for _, message in watcher.commands)

    # On a busy machine a robot may take longer to wake up than a goal is waited for.
    assert any(watcher.send_goal("odom", *goal) or watcher.wait_for(moves, 10.0) for _ in range(10))
    # A goal counts as reached within 0.3 m.
    assert watcher.wait_for(lambda: far() < 0.31)
    assert watcher.wait_for(lambda: watcher.commands[-1][1].linear.y == 0.0)
    assert min(twist.linear.y for twist in twists) < -0.3
    assert max(abs(twist.linear.x) for twist in twists) < 0.1
    # It turns at the goal alone, to the heading there.
    told = [message for _, message in watcher.commands if message.linear.y < -0.3]
    assert max(abs(message.angular.z) for message in told) < 0.01
