# SPDX-License-Identifier: Apache-2.0
"""``pm01 identify`` on bags as people have them: names, kinds, topics, parts, and broken ones."""

from __future__ import annotations

import math
import shutil

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from pm01_nav.cli import pm01
from pm01_nav.deploy.recording import read_recording
from pm01_nav.errors import InputError

rosbags = pytest.importorskip("rosbags")
from rosbags import rosbag1, rosbag2  # noqa: E402
from rosbags.typesys import Stores, get_typestore  # noqa: E402

START = 1000.0
TWIST, STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
ODOMETRY, SCAN = "nav_msgs/msg/Odometry", "sensor_msgs/msg/LaserScan"


class Bag:
    """Write a bag of either kind with our own messages."""

    def __init__(self, path, ros1=False, stamped=False):
        self.store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
        self.ros1, self.command_type = ros1, STAMPED if stamped else TWIST
        if ros1:
            self.writer = rosbag1.Writer(path)
        else:
            self.writer = rosbag2.Writer(
                path, version=8, storage_plugin=rosbag2.StoragePlugin.SQLITE3
            )
        self.writer.open()
        self.connections = {}

    def make(self, name, *values):
        return self.store.types[name](*values)

    def header(self, t):
        nanoseconds = round(t * 1e9)
        stamp = self.make("builtin_interfaces/msg/Time", *divmod(nanoseconds, 10**9))
        first = (0,) if self.ros1 else ()
        return self.make("std_msgs/msg/Header", *first, stamp, "base_link")

    def vector(self, *values, kind="Vector3"):
        return self.make(f"geometry_msgs/msg/{kind}", *map(float, values))

    def twist(self, v, w):
        return self.make(TWIST, self.vector(v, 0, 0), self.vector(0, 0, w))

    def write(self, topic, kind, message, t):
        if topic not in self.connections:
            new = self.writer.add_connection(topic, kind, typestore=self.store)
            self.connections[topic] = new
        serialize = self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr
        data = serialize(message, kind)
        self.writer.write(self.connections[topic], round(t * 1e9), data)

    def command(self, topic, v, w, t):
        message = self.twist(v, w)
        if self.command_type == STAMPED:
            message = self.make(STAMPED, self.header(t), message)
        self.write(topic, self.command_type, message, t)

    def odometry(self, topic, pose, twist, t, at=None):
        unknown = np.zeros(36)
        turn = self.vector(0, 0, math.sin(pose[2] / 2), math.cos(pose[2] / 2), kind="Quaternion")
        place = self.vector(pose[0], pose[1], 0, kind="Point")
        place = self.make("geometry_msgs/msg/Pose", place, turn)
        place = self.make("geometry_msgs/msg/PoseWithCovariance", place, unknown)
        speed = self.make("geometry_msgs/msg/TwistWithCovariance", self.twist(*twist), unknown)
        message = self.make(ODOMETRY, self.header(t), "base_link", place, speed)
        self.write(topic, ODOMETRY, message, t if at is None else at)

    def scan(self, topic, ranges, t):
        ranges = np.asarray(ranges, dtype=np.float32)
        angles = (-math.pi, math.pi - 2 * math.pi / len(ranges), 2 * math.pi / len(ranges))
        limits = (0.0, 0.0, 0.1, 8.0)
        message = self.make(SCAN, self.header(t), *angles, *limits, ranges, ranges[:0])
        self.write(topic, SCAN, message, t)


def write_drive(path, *, seconds=40.0, prefix="", ros1=False, stamped=False, scans="room"):
    """A base with a lag of 0.1 s that drives as told, in a corridor or a room of 6 m x 5 m."""
    bag, rng = Bag(path, ros1, stamped), np.random.default_rng(2)
    program = ((0.3, 0.0), (0.0, 0.8), (0.0, 0.0), (-0.3, 0.0), (0.0, -0.8), (0.3, 0.4))
    pose, now = np.zeros(3), np.zeros(2)
    beams = -math.pi + 2 * math.pi / 180 * np.arange(180)
    for k in range(int(seconds * 100)):
        t = START + 0.01 * k
        wanted = np.array(program[int(0.01 * k / 2.0 + 1e-9) % 6])
        now = wanted + (now - wanted) * math.exp(-0.01 / 0.1)
        pose += 0.01 * np.array([now[0] * math.cos(pose[2]), now[0] * math.sin(pose[2]), now[1]])
        if k % 10 == 0:
            bag.command(f"{prefix}/cmd_vel", *wanted, t)
        if k % 5 == 0:
            # The speed at the end of this step, which is 0.01 s later.
            noisy = now + rng.normal(0.0, [0.003, 0.006])
            bag.odometry(f"{prefix}/odom", pose, noisy, t + 0.01)
        if scans and k % 20 == 0:
            cos, sin = np.cos(beams + pose[2]), np.sin(beams + pose[2])
            walls = [(sin, 2.5 - pose[1]), (-sin, 2.5 + pose[1])]
            if scans == "room":
                walls += [(cos, 3.0 - pose[0]), (-cos, 3.0 + pose[0])]
            with np.errstate(divide="ignore"):
                ways = [np.where(n > 1e-9, d / n, np.inf) for n, d in walls]
            ranges = np.min(ways, axis=0) + rng.normal(0.0, 0.01, 180)
            bag.scan(f"{prefix}/lidar/scan", np.where(ranges > 8.0, np.inf, ranges), t + 0.01)
    bag.writer.close()


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """A folder that is called like a file, a ROS 1 bag, and others."""
    folder = tmp_path_factory.mktemp("bags")
    write_drive(folder / "folder.bag", prefix="/robot", stamped=True)
    write_drive(folder / "old.bag", seconds=30.0, ros1=True, scans=None)
    write_drive(folder / "corridor", scans="corridor")
    return folder


NAMED = ("--odom", "/robot/odom", "--cmd-vel", "/robot/cmd_vel", "--scan", "/robot/lidar/scan")


def identify(*arguments):
    return CliRunner().invoke(pm01, ["identify", *map(str, arguments)])


def test_a_folder_called_bag_with_stamped_commands_on_other_topics(bags, tmp_path):
    out, plot = tmp_path / "me.yaml", tmp_path / "fit.png"
    result = identify(bags / "folder.bag", *NAMED, "-o", out, "--plot", plot)
    assert result.exception is None, result.output
    ranges = yaml.safe_load((tmp_path / "me_ranges.yaml").read_text())
    for name in ("wheel_left_factor", "wheel_right_factor", "wheel_separation_factor"):
        assert ranges[name][0] <= 1.0 <= ranges[name][1], name
        assert ranges[name][1] - ranges[name][0] < 0.06, name
    assert ranges["command_delay_s"][0] == 0.0
    low, high = ranges["actuator_lag"]
    assert low <= 0.1 <= high
    assert high - low < 0.05
    assert yaml.safe_load(out.read_text())["actuator"]["lag_s"] == pytest.approx(0.1, abs=0.01)
    assert "linear_max: not shown by the drive, left as described" in result.output
    assert plot.stat().st_size > 10_000


def test_a_ros1_bag_a_file_without_its_folder_and_parts(bags):
    whole = read_recording(bags / "old.bag", scan="none")
    # 30 s of odometry every 0.05 s and of commands every 0.1 s.
    assert (len(whole.odometry), len(whole.commands), whole.scans) == (600, 300, [])
    # The bag begins with the first command.
    part = read_recording(bags / "old.bag", scan="none", begin=10.0, end=20.0)
    assert part.begin == pytest.approx(START)
    assert part.odometry[[0, -1], 0] == pytest.approx([START + 10.01, START + 19.96])
    # What is driven at 10 s was told before.
    assert part.commands[[0, -1], 0] == pytest.approx([START, START + 20.0])
    database = next((bags / "corridor").glob("*.db3"))
    assert len(read_recording(database, scan="/lidar/scan").odometry) == 800


def test_several_bags_and_a_corridor(bags, tmp_path):
    out = tmp_path / "me.yaml"
    result = identify(bags / "old.bag", bags / "old.bag", "--scan", "none", "-o", out)
    assert result.exception is None, result.output
    result = identify(bags / "corridor", "--scan", "/lidar/scan", "-o", out)
    assert result.exception is None, result.output
    # Its walls tell how it turned and nothing of how far it went along them.
    assert "travel_scale: not shown" in " ".join(result.output.split())
    ranges = yaml.safe_load((tmp_path / "me_ranges.yaml").read_text())
    assert "odometry_scale" not in ranges
    assert ranges["wheel_left_factor"] == pytest.approx([1.0, 1.0], abs=0.02)


def test_bad_bags_say_so_in_one_line_and_write_nothing(bags, tmp_path):
    torn = tmp_path / "torn.bag"
    torn.write_bytes((bags / "old.bag").read_bytes()[:20_000])
    (tmp_path / "text.mcap").write_text("hello")
    shutil.copytree(bags / "corridor", tmp_path / "half")
    next((tmp_path / "half").glob("*.db3")).write_bytes(b"SQLite format 3\0" + bytes(4000))
    old, scan = str(bags / "old.bag"), ("--scan", "none")
    cases = {
        (torn, *scan): "torn.bag: is no readable",
        (tmp_path / "text.mcap", *scan): "text.mcap: is no readable",
        (tmp_path / "half", *scan): "half: is no readable",
        (tmp_path / "missing", *scan): "missing: is no readable",
        (old,): "has no messages on /scan; its topics: /cmd_vel, /odom",
        (old, *scan, "--odom", "/cmd_vel"): "one is given twice",
        (old, *scan, "--from", "40"): "from = 40: the bag is 30.0 s long",
        (old, *scan, "--from", "20", "--to", "10"): "to = 10: must be more than from = 20",
        (old, *scan, "--from", "29"): "at least 20 and 200 are needed",
    }
    for arguments, words in cases.items():
        error = identify(*arguments, "-o", tmp_path / "me.yaml").exception
        assert isinstance(error, InputError), arguments
        assert words in str(error)
        assert "\n" not in str(error)
    with pytest.raises(InputError, match="needed: nav_msgs/msg/Odometry"):
        read_recording(old, scan="none", odometry="/cmd_vel", command="/odom")
    assert not list(tmp_path.glob("me*"))


def test_stamps_that_are_no_times_and_numbers_that_are_none(tmp_path):
    bag = Bag(tmp_path / "odd")
    for k in range(10):
        t = START + 0.1 * k
        bag.command("/cmd_vel", 0.1, math.nan if k == 3 else 0.0, t)
        # The driver leaves its stamps empty.
        bag.odometry("/odom", (0, 0, 0), (math.nan if k == 5 else 0.1, 0), 0.0, at=t)
    bag.writer.close()
    recording = read_recording(tmp_path / "odd", scan="none")
    assert len(recording.commands) == len(recording.odometry) == 9
    expected = [START + 0.1 * k for k in range(10) if k != 5]
    assert recording.odometry[:, 0] == pytest.approx(expected, abs=1e-6)
