# SPDX-License-Identifier: Apache-2.0
"""A simulated robot on DDS, for the tests: another process, with nothing of ours but the types."""

from __future__ import annotations

import sys
import time

import numpy as np
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from pm01_nav.deploy import dds_types as types
from pm01_nav.deploy.dds import dds_config

RATE_HZ = 50


def stamp(seconds: float) -> types.Time:
    return types.Time(int(seconds), int(1e9 * (seconds % 1.0)))


def main() -> None:
    domain = int(sys.argv[1])
    owner = Domain(domain, dds_config("127.0.0.1", ()))
    participant = DomainParticipant(domain)
    best_effort = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(1))
    scans = DataWriter(participant, Topic(participant, "rt/scan", types.LaserScan), qos=best_effort)
    odometry = DataWriter(participant, Topic(participant, "rt/odom", types.Odometry))
    commands = DataReader(participant, Topic(participant, "rt/cmd_vel", types.Twist))
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    x = y = yaw = v = u = w = 0.0
    for step in range(60 * RATE_HZ):
        for twist in commands.take(10):
            if hasattr(twist, "linear"):  # A writer that leaves sends a sample without data.
                v, u, w = twist.linear.x, twist.linear.y, twist.angular.z
        cos, sin = np.cos(yaw), np.sin(yaw)
        x += (v * cos - u * sin) / RATE_HZ
        y += (v * sin + u * cos) / RATE_HZ
        yaw += w / RATE_HZ
        message = types.Odometry()
        message.header.stamp = stamp(time.time())
        message.pose.pose.position = types.Point(float(x), float(y), 0.0)
        message.pose.pose.orientation = types.Quaternion(
            0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2))
        )
        message.twist.twist = types.Twist(types.Vector3(x=v, y=u), types.Vector3(z=w))
        odometry.write(message)
        if step % 5 == 0:
            scan = types.LaserScan(
                header=types.Header(stamp(time.time()), "base_scan"),
                angle_min=-np.pi,
                angle_increment=2.0 * np.pi / 360,
                range_min=0.12,
                range_max=3.5,
                ranges=[float("inf")] * 360,
            )
            scans.write(scan)
        time.sleep(1.0 / RATE_HZ)
    del owner


main()
