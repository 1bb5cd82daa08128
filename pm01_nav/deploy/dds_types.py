# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 messages that a drive needs, as DDS has them on the wire.

Field by field as in ``common_interfaces``; the type's name is what lets ROS 2's readers match.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from types import new_class
from typing import Any

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, float64, int32, sequence, uint32

COVARIANCE = array[float64, 36]
DEFAULTS: dict[Any, Any] = {
    bool: bool,
    str: str,
    int32: int,
    uint32: int,
    float32: float,
    float64: float,
    sequence[float32]: list,
    COVARIANCE: lambda: [0.0] * 36,
}
"""What makes a field's first value: for numbers zero; another message makes its own."""


def _message(package: str, name: str, **fields: Any) -> Any:
    """Return the class of the message ``package``/``name`` with these fields, in this order."""

    def fill(namespace: dict[str, Any]) -> None:
        namespace |= {"__module__": __name__, "__annotations__": fields}
        for key, kind in fields.items():
            namespace[key] = field(default_factory=DEFAULTS.get(kind, kind))

    typename = f"{package}.msg.dds_.{name}_"
    return dataclass(new_class(name, (IdlStruct,), {"typename": typename}, fill))


Time = _message("builtin_interfaces", "Time", sec=int32, nanosec=uint32)
Header = _message("std_msgs", "Header", stamp=Time, frame_id=str)
Bool = _message("std_msgs", "Bool", data=bool)
Clock = _message("rosgraph_msgs", "Clock", clock=Time)
Point = _message("geometry_msgs", "Point", x=float64, y=float64, z=float64)
Vector3 = _message("geometry_msgs", "Vector3", x=float64, y=float64, z=float64)
Quaternion = _message("geometry_msgs", "Quaternion", x=float64, y=float64, z=float64, w=float64)
Pose = _message("geometry_msgs", "Pose", position=Point, orientation=Quaternion)
PoseStamped = _message("geometry_msgs", "PoseStamped", header=Header, pose=Pose)
Twist = _message("geometry_msgs", "Twist", linear=Vector3, angular=Vector3)
TwistStamped = _message("geometry_msgs", "TwistStamped", header=Header, twist=Twist)
PoseWithCovariance = _message(
    "geometry_msgs", "PoseWithCovariance", pose=Pose, covariance=COVARIANCE
)
TwistWithCovariance = _message(
    "geometry_msgs", "TwistWithCovariance", twist=Twist, covariance=COVARIANCE
)
Odometry = _message(
    "nav_msgs",
    "Odometry",
    header=Header,
    child_frame_id=str,
    pose=PoseWithCovariance,
    twist=TwistWithCovariance,
)
LaserScan = _message(
    "sensor_msgs",
    "LaserScan",
    header=Header,
    angle_min=float32,
    angle_max=float32,
    angle_increment=float32,
    time_increment=float32,
    scan_time=float32,
    range_min=float32,
    range_max=float32,
    ranges=sequence[float32],
    intensities=sequence[float32],
)
