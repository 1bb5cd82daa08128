# SPDX-License-Identifier: Apache-2.0
"""The planar simulator as a robot: a clock, a lidar, odometry, and motors that want to be told.

It stands in for a robot where there is none: behind ROS topics (``sim_node``), DDS, in tests.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pm01_nav.arrays import NUMPY
from pm01_nav.backends import BackendName, make_simulator
from pm01_nav.deploy.controller import Controller
from pm01_nav.deploy.goals import Goal
from pm01_nav.deploy.messages import Odometry, Scan
from pm01_nav.geometry import to_world
from pm01_nav.robot import RobotSpec, load_robot
from pm01_nav.task.randomization import RandomizationConfig, load_randomization
from pm01_nav.task.tasks import task_config, task_names
from pm01_nav.task.worlds import world_pool
from pm01_nav.worlds.files import read_world
from pm01_nav.worlds.pool import WorldPool, build_pool

if TYPE_CHECKING:
    from pm01_nav.deploy.recording import Recorder

NUM_WORLDS = 32
"""Of a suite; each reset draws one of them."""
MARGIN = 0.1
"""Starts and goals leave so much more room than the robot needs [m]."""


class SimulatedRobot:
    """One robot in one world at a time; ``step`` moves time on by ``dt``."""

    def __init__(
        self,
        robot: RobotSpec,
        pool: WorldPool,
        *,
        seed: int = 0,
        dt: float = 0.02,
        scan_period: float = 0.1,
        command_timeout: float = 0.2,
        randomization: RandomizationConfig | None = None,
        backend: BackendName = "planar",
    ) -> None:
        """Put ``robot`` at a start in a world of ``pool``.

        ``dt`` [s] is a step and the time between two odometries, ``scan_period`` [s] that between
        two scans. Without a command for ``command_timeout`` [s] the motors stop, as a base with a
        watchdog of its own does. With ``randomization`` something is wrong with the robot; only the
        planar ``backend`` has that.
        """
        self.robot = robot
        self.drive = robot.base
        self.dt = dt
        self._steps_per_scan = max(1, round(scan_period / dt))
        self._command_timeout = command_timeout
        how = {"control_dt": dt, "goal_distance": (2.0, 1e9)}
        self._simulator = make_simulator(backend, NUMPY, robot, pool, 1, **how)
        if randomization is not None:
            self._simulator.perturb(randomization.ranges(robot, dt))
        self._simulator.seed([seed])
        self.time = 0.0
        """[s]; a reset does not turn it back."""
        self.collisions = 0
        """How often it drove into something; it then stands where it was before."""
        self._steps = 0
        self._command = np.zeros((1, self.drive.size))
        self._commanded_at = -math.inf
        self.reset()

    def reset(self, world: int | None = None) -> None:
        """Start again, somewhere else, in a world of the pool."""
        worlds = None if world is None else np.array([world])
        self._simulator.reset(worlds=worlds)
        self._command[:] = 0.0
        self._commanded_at = -math.inf

    def command(self, *command: float) -> None:
        """Tell the motors a number for each axis of the drive, such as v and w [m/s, rad/s].

        What is not finite is taken for a stop.
        """
        self._command[0] = command if math.isfinite(sum(command)) else 0.0
        self._commanded_at = self.time

    def step(self) -> bool:
        """Move on by ``dt``; tell whether there is a new scan."""
        simulator = self._simulator
        if self.time - self._commanded_at > self._command_timeout + 1e-9:
            self._command[:] = 0.0
        before = simulator.state.pose.copy()
        simulator.step(self._command)
        if simulator.state.contact[0]:
            self.collisions += 1
            simulator.place(np.array([0]), before, simulator.state.goal)
        self._steps += 1
        self.time = self._steps * self.dt
        return self._steps % self._steps_per_scan == 0

    def scan(self) -> Scan:
        """Return what the lidar sees now."""
        lidar = self.robot.lidar
        scan = Scan(
            self.time,
            lidar.angle_min,
            lidar.angle_increment,
            lidar.range_min,
            lidar.range_max,
            self._simulator.scan[0],
        )
        return scan.mirrored() if lidar.upside_down else scan

    def odometry(self) -> Odometry:
        """Return where the robot believes to be, in a frame that begins as the world's."""
        simulator = self._simulator
        pose, twist = simulator.measured_pose[0], simulator.measured_twist[0]
        return Odometry(self.time, pose.copy(), twist.copy())

    @property
    def pose(self) -> NDArray[np.float64]:
        """Where the robot really is, shape (3,) [m, m, rad] in the world."""
        return self._simulator.state.pose[0].copy()

    @property
    def goal(self) -> NDArray[np.float64]:
        """The goal of the present episode, shape (2,) [m] in the world."""
        return self._simulator.state.goal[0].copy()

    def odometry_frame(self) -> NDArray[np.float64]:
        """Return where odometry's frame lies in the world, shape (3,): its drift so far."""
        true, measured = self.pose, self.odometry().pose
        turn = true[2] - measured[2]
        origin = to_world(-measured[:2], np.array([0.0, 0.0, turn])) + true[:2]
        return np.array([*origin, turn])

    def place(self, pose: NDArray[np.float64], goal: NDArray[np.float64]) -> None:
        """Put the robot at rest at ``pose`` (3,) with another ``goal`` (2,)."""
        self._simulator.place(np.array([0]), pose[None], goal[None])


def simulated_robot(
    world: str,
    robot: str | RobotSpec,
    *,
    seed: int,
    dt: float,
    scan_period: float = 0.1,
    command_timeout: float = 0.2,
    randomization: str = "off",
) -> SimulatedRobot:
    """Return ``robot`` (or that of a name or a YAML file) in ``world``: a suite or a world's file.

    ``randomization`` is as for ``load_randomization``, the rest as for ``SimulatedRobot``.

    Raises:
        InputError: there is no such world or robot, or no way leads through the world.
    """
    spec = robot if isinstance(robot, RobotSpec) else load_robot(robot)
    if world in task_names():
        pool = world_pool(task_config(world), "held_out", NUM_WORLDS, 1, robot=spec)
    else:
        pool = build_pool([read_world(world)], spec.footprint.circumscribed_radius + MARGIN)
    return SimulatedRobot(
        spec,
        pool,
        seed=seed,
        dt=dt,
        scan_period=scan_period,
        command_timeout=command_timeout,
        randomization=load_randomization(randomization),
    )


def drive_simulated(
    controller: Controller, robot: SimulatedRobot, seconds: float, recorder: Recorder | None = None
) -> int:
    """Drive for ``seconds`` of simulated time; return how many goals were reached.

    After each goal the robot gets another one in the same world. No time goes by while the policy
    thinks.
    """
    controller.clock = lambda: robot.time
    arrived, due, until = 0, robot.time, robot.time + seconds
    goals = _goals(robot)
    controller.set_goal(next(goals))
    while robot.time < until - 1e-9:
        new_scan = robot.step()
        odometry = robot.odometry()
        controller.see_odometry(odometry, robot.time)
        if recorder is not None:
            recorder.odometry(odometry, robot.time)
        if new_scan:
            scan = robot.scan()
            controller.see_scan(scan, robot.time)
            if recorder is not None:
                recorder.scan(scan, robot.time)
        if robot.time < due - 1e-9:
            continue
        due += controller.control_dt
        status = controller.step(robot.time)
        robot.command(*status.verdict.command)
        if recorder is not None:
            recorder.command(status.verdict.command, robot.time)
        if status.arrived:
            arrived += 1
            controller.set_goal(next(goals))
    return arrived


def _goals(robot: SimulatedRobot) -> Iterator[Goal]:
    """Yield the episode's goal, then its start, and so on: a way there is a way back."""
    there, back = robot.goal, robot.pose[:2]
    while True:
        yield Goal(*map(float, there))
        there, back = back, there
