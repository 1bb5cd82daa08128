# SPDX-License-Identifier: Apache-2.0
"""What a URDF's plugins and controllers say about the drive."""

from __future__ import annotations

import re
from xml.etree.ElementTree import Element

from pm01_nav.errors import InputError
from pm01_nav.robot_import.elements import LARGEST
from pm01_nav.robot_import.urdf import Urdf

HOLONOMIC = ("mecanum", "planar_move", "planarmove", "force_based_move", "omni_drive", "omnidrive")
"""Words in the names of plugins whose robots drive sideways, too."""
STEERED = ("ackermann", "tricycle", "bicycle")
DIFFERENTIAL = (r"diff[\w-]*drive", r"skid[_-]?steer", r"drive_?plugin_?\w*wheel", r"6wd")

# What plugins of several generations of Gazebo call the same thing, without "_", in small letters.
_TAGS = {
    "radius": ("wheelradius",),
    "diameter": ("wheeldiameter",),
    "separation": ("wheelseparation",),
    "linear_min": ("minlinearvelocity", "minvelocity"),
    "linear_max": ("maxlinearvelocity", "maxvelocity"),
    "angular_max": ("maxangularvelocity",),
    "linear_acceleration": ("maxlinearacceleration", "maxacceleration"),
    "angular_acceleration": ("maxangularacceleration",),
}


class Drive:
    """The plugin that moves the robot; empty without one."""

    def __init__(self, urdf: Urdf) -> None:
        """Find the plugin, and the joints whose speed something controls."""
        self.where = ""
        self.kind = ""
        """``differential``, ``holonomic`` or ``steered``; empty without a plugin."""
        self.joints: tuple[list[str], list[str]] = ([], [])
        """Of the driven wheels to the left and to the right."""
        self.figures: dict[str, float] = {}
        self.driven = _driven(urdf.root)
        """Joints with a controller of their speed."""
        for plugin in urdf.root.iter("plugin"):
            kind = _kind(plugin)
            if kind:
                self.kind = kind
                self.where = f"{urdf.path}: plugin {plugin.get('name', '')[:60]!r}"
                if kind == "differential":
                    self._read(plugin)
                return
        # A controller's kind stands in the name of its file.
        for element in urdf.root.iter("parameters"):
            name = (element.text or "").strip().rsplit("/", 1)[-1]
            self.kind = self.kind or _kind_of(name.lower())
            if self.kind and not self.where:
                self.where = f"{urdf.path}: parameters {name[:60]!r}"

    def _read(self, plugin: Element) -> None:
        texts: dict[str, list[str]] = {}
        for element in plugin:
            tag = str(element.tag).lower().replace("_", "")
            texts.setdefault(tag, []).append(" ".join((element.text or "").split()))
            for side, names in zip(("left", "right"), self.joints, strict=True):
                # leftFrontJoint, left_joint, leftJoints with commas ...
                if side in tag and "joint" in tag and "steer" not in tag:
                    names.extend(name for name in re.split(r"[,\s]+", element.text or "") if name)
        for key, tags in _TAGS.items():
            found = [text for tag in tags for text in texts.get(tag, [])]
            if found:
                self.figures[key] = _number(found[0], f"{self.where}: {key}")
        if "diameter" in self.figures:
            self.figures.setdefault("radius", self.figures.pop("diameter") / 2.0)


def _kind(plugin: Element) -> str:
    """Tell what drive a plugin makes, by its file or else by its name."""
    file, name = plugin.get("filename", "").lower(), plugin.get("name", "").lower()
    return _kind_of(file) or _kind_of(name)


def _kind_of(text: str) -> str:
    if any(word in text for word in HOLONOMIC):
        return "holonomic"
    if any(word in text for word in STEERED):
        return "steered"
    if any(re.search(pattern, text) for pattern in DIFFERENTIAL):
        return "differential"
    return ""


def _driven(root: Element) -> frozenset[str]:
    """Name the joints that ``ros2_control`` or a transmission turns at a speed."""
    driven = {
        joint.get("name", "")
        for joint in root.findall("ros2_control/joint")
        for interface in joint.findall("command_interface")
        if interface.get("name") == "velocity"
    }
    for transmission in root.findall("transmission"):
        for joint in transmission.findall("joint"):
            interfaces = " ".join(e.text or "" for e in joint.findall("hardwareInterface"))
            if "Velocity" in interfaces:
                driven.add(joint.get("name", ""))
    return frozenset(driven)


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    # NaN fails the comparison, too.
    if not abs(value) <= LARGEST:
        limit = f"-{LARGEST:g} to {LARGEST:g}"
        raise InputError(f"{where} = {text[:60]!r}: must be a number from {limit}")
    return value
