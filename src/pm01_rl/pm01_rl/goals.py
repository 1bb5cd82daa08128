# SPDX-License-Identifier: Apache-2.0
"""Goals from RViz and from Nav2's actions, and where they lie in odometry's frame, by tf2."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import NavigateThroughPoses, NavigateToPose
from rclpy.time import Time
from tf2_ros import Buffer, TransformException

from pm01_nav.deploy.controller import Status
from pm01_nav.deploy.freshness import Stream
from pm01_nav.deploy.goals import Goal
from pm01_nav.deploy.messages import heading_of, seconds, yaw_of_quaternion
from pm01_nav.deploy.safety import Reason
from pm01_nav.geometry import to_world


class Outcome(NamedTuple):
    """How an errand ended, kept apart from whatever comes after it."""

    kind: str
    """arrived, canceled, dropped, preempted or stopped."""
    reasons: tuple[Reason, ...] = ()
    detail: str = ""

    def __str__(self) -> str:
        """Say it in a line."""
        said = [reason.value for reason in self.reasons if reason is not Reason.NO_GOAL]
        return "; ".join([self.kind, *said, *filter(None, [self.detail])])


class Frames(NamedTuple):
    """The two frames that stand still (REP-105)."""

    odometry: str
    map: str


class Place(NamedTuple):
    """A goal in a frame that stands still."""

    frame: str
    x: float
    y: float
    yaw: float | None


class Client(Protocol):
    """Whoever sent an errand by an action, and hears of its end."""

    def end(self, outcome: Outcome) -> None:
        """Hear it."""
        ...


@dataclass
class Errand:
    """One or several goals as they were given, and who waits for their end."""

    poses: list[PoseStamped]
    started: float
    client: Client | None = None
    """Who sent it by an action; None for a goal from a topic."""
    elapsed: float = 0.0
    """Since it started [s]."""
    places: list[Place] = field(default_factory=list)
    """Where the poses are; empty until tf knows all their frames."""
    begun: bool = False
    """Whether the controller has the goals."""
    remaining: int = 0
    """How many of the poses are still to be reached."""
    transforms: Stream = field(default_factory=Stream)

    def __post_init__(self) -> None:
        """Nothing is reached yet."""
        self.remaining = len(self.poses)

    def end(self, outcome: Outcome) -> None:
        """Say how it ended."""
        if self.client is not None:
            self.client.end(outcome)

    def locate(self, frames: Frames, buffer: Buffer) -> bool:
        """Find out, once, where the poses are; tell whether it is known."""
        if not self.places:
            found = [anchored(pose, frames, buffer) for pose in self.poses]
            if None not in found:
                self.places = found
        return bool(self.places)

    def goals(self, frames: Frames, buffer: Buffer) -> tuple[list[Goal] | None, float | None]:
        """Return the goals that remain in odometry's frame, and the transform's stamp [s].

        The goals are None where tf does not know the way from the map; the stamp is None where no
        transform was needed, or a fixed one.
        """
        places = self.places[len(self.places) - self.remaining :]
        if all(place.frame == frames.odometry for place in places):
            return [Goal(place.x, place.y, place.yaw) for place in places], None
        try:
            found = buffer.lookup_transform(frames.odometry, frames.map, Time())
        except TransformException:
            return None, None
        frame = planar(found.transform)
        stamp = seconds(found.header.stamp) or None
        return [
            Goal(p.x, p.y, p.yaw) if p.frame == frames.odometry else Goal(*moved(p, frame))
            for p in places
        ], stamp

    def transform_age(self, stamp: float | None, now: float, clock: float) -> float:
        """Return how old the transform is that was just used [s]; 0 for a fixed one, None.

        ``now`` [s] is the time that ages are measured by, ``clock`` [s] the node's, of which
        stamps are if all machines' clocks agree. If they do not, or whoever publishes the transform
        dates it ahead, it still grows old here once it is published no longer.
        """
        if stamp is None:
            return 0.0
        self.transforms.accept(stamp, now)
        return max(clock - stamp, self.transforms.age(now))


def is_place(pose: PoseStamped) -> bool:
    """Tell whether a pose has a finite position on the floor and a heading, or asks for none."""
    heading = heading_of(pose.pose)
    numbers = (pose.pose.position.x, pose.pose.position.y, heading or 0.0)
    return all(map(math.isfinite, numbers))


def anchored(pose: PoseStamped, frames: Frames, buffer: Buffer) -> Place | None:
    """Return where a pose was at its stamp, in a frame that stands still; None if tf cannot say.

    A pose in a frame that moves, such as base_link, would otherwise move along with the robot. As
    in Nav2 it is fixed in the map; where there is no map, in odometry's frame.
    """
    point, heading = pose.pose.position, heading_of(pose.pose)
    place = Place(pose.header.frame_id or frames.odometry, point.x, point.y, heading)
    if place.frame in frames:
        return place
    has_map = buffer.can_transform(frames.map, frames.odometry, Time())
    target = frames.map if has_map else frames.odometry
    try:
        found = buffer.lookup_transform(target, place.frame, Time.from_msg(pose.header.stamp))
    except TransformException:
        return None
    return Place(target, *moved(place, planar(found.transform)))


def planar(transform: object) -> np.ndarray:
    """Return x, y, yaw of a ``geometry_msgs/Transform``, shape (3,) [m, m, rad]."""
    shift, turn = transform.translation, transform.rotation
    return np.array([shift.x, shift.y, yaw_of_quaternion(turn.x, turn.y, turn.z, turn.w)])


def moved(place: Place, frame: np.ndarray) -> tuple[float, float, float | None]:
    """Return x, y and yaw of a place in the frame in which its own is at ``frame`` (3,)."""
    x, y = to_world(np.array([place.x, place.y]), frame)
    return float(x), float(y), None if place.yaw is None else place.yaw + float(frame[2])


def result(action: type, outcome: Outcome) -> NavigateToPose.Result | NavigateThroughPoses.Result:
    """Return what a client of ``action`` is told at the end: from Jazzy on also why."""
    message = action.Result()
    if outcome.kind == "arrived":
        return message
    if hasattr(message, "error_code"):
        lost = Reason.LOST_TRANSFORM in outcome.reasons
        message.error_code = message.TF_ERROR if lost else message.UNKNOWN
    if hasattr(message, "error_msg"):
        message.error_msg = str(outcome)
    return message


def outcome_of(kind: str, status: Status | None, detail: str | None) -> Outcome:
    """Return an outcome with the reasons of the step in which it came about."""
    return Outcome(kind, status.verdict.reasons if status else (), detail or "")
