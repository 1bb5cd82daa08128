# SPDX-License-Identifier: Apache-2.0
"""The exported policy: the same as in torch, careful with what it is given, and light."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from numpy.typing import NDArray

from pm01_nav.config import merge, validate
from pm01_nav.errors import InputError
from pm01_nav.policy import OnnxPolicy
from pm01_nav.policy.export import DeployedPolicy, export_policy, greedy_policy, policy_metadata
from pm01_nav.policy.onnx_policy import METADATA_KEY
from pm01_nav.robot import RobotSpec, load_robot
from pm01_nav.task.config import observation_layout
from pm01_nav.task.tasks import task_config
from pm01_nav.training.algorithms.ppo import PPOConfig
from pm01_nav.training.ppo import make_policy

INF, NAN = np.inf, np.nan
ZERO = np.zeros(2)


class Exported:
    """A small policy with random weights, in torch and in a file."""

    def __init__(self, task: str, folder: Path) -> None:
        torch.manual_seed(3)
        config = task_config(task)
        self.robot = config.robot_spec()
        self.layout = observation_layout(config, self.robot)
        self.policy = make_policy(PPOConfig(net_arch=(16, 16)), self.layout)
        with torch.no_grad():
            # Fresh SB3 policies answer nearly zero; so large an answer is clipped now and then.
            self.policy.action_net.weight.mul_(200.0)
        self.path = folder / f"{task}.onnx"
        metadata = policy_metadata(self.layout, self.robot, config.control_dt, {"task": task})
        export_policy(self.policy, self.layout, metadata, self.path)


@pytest.fixture(scope="module", params=["static", "article"])
def exported(request, tmp_path_factory) -> Exported:
    """Return a policy that sees normalised nearness by sector, or the article's raw numbers."""
    return Exported(request.param, tmp_path_factory.mktemp("policy"))


@pytest.fixture(scope="module")
def static(tmp_path_factory) -> Exported:
    return Exported("static", tmp_path_factory.mktemp("policy"))


@pytest.fixture
def scan(static: Exported) -> NDArray[np.float32]:
    return np.random.default_rng(1).uniform(0.2, 3.5, 360).astype(np.float32)


def rewrite(static: Exported, path: Path, metadata: Any, *, remove: bool = False) -> Path:
    """Write the policy with other metadata: text as it is, anything else as JSON."""
    model = onnx.load(static.path)
    kept = [(p.key, p.value) for p in model.metadata_props if p.key != METADATA_KEY]
    del model.metadata_props[:]
    if not remove:
        text = metadata if isinstance(metadata, str) else json.dumps(metadata)
        kept.append((METADATA_KEY, text))
    for key, value in kept:
        model.metadata_props.add(key=key, value=value)
    onnx.save(model, path)
    return path


def test_file_answers_like_torch(exported: Exported) -> None:
    low, high = exported.layout.bounds
    scale = np.array(exported.layout.scale if exported.layout.normalize else 1.0)
    low, high = np.array(low) * scale, np.array(high) * scale
    rng = np.random.default_rng(0)
    n, size = 1000, exported.layout.size
    observations = rng.uniform(low, high, (n, size))
    # Extremes: all least, all greatest, each number at one of its ends, and far outside.
    observations[0], observations[1], observations[2] = low, high, 0.0
    observations[3:300] = np.where(rng.random((297, size)) < 0.5, low, high)
    observations[300:310] *= 1e6
    observations = observations.astype(np.float32)
    with torch.no_grad():
        module = DeployedPolicy(exported.policy, exported.layout)
        expected = module(torch.from_numpy(observations)).numpy()
    session = onnxruntime.InferenceSession(exported.path)
    found = session.run(None, {"observation": observations})[0]
    # Both compute in float32, adding up 16 to 60 products in different orders.
    assert found == pytest.approx(expected, abs=1e-5)
    limits = exported.layout.drive
    low = np.array([limits.linear_min, -limits.angular_max])
    high = np.array([limits.linear_max, limits.angular_max])
    assert ((found >= low - 1e-6) & (found <= high + 1e-6)).all()
    # The comparison covers both answers at the limits and answers between.
    at_limit = np.isclose(found, low) | np.isclose(found, high)
    assert at_limit.any(axis=1).mean() > 0.01
    assert (~at_limit).all(axis=1).mean() > 0.1


def test_greedy_action_of_training_is_the_command(static: Exported) -> None:
    # What SB3 predicts from the environment's normalised observation, clipped to [-1, 1] and
    # mapped to the limits by hand, is what the file commands.
    rng = np.random.default_rng(4)
    observations = rng.uniform(*static.layout.bounds, (50, static.layout.size)).astype(np.float32)
    actions = np.clip(static.policy.predict(observations, deterministic=True)[0], -1, 1)
    expected = np.array([0.15, 0.0]) + actions * np.array([0.35, 1.5])
    session = onnxruntime.InferenceSession(static.path)
    scale = np.array(static.layout.scale, dtype=np.float32)
    found = session.run(None, {"observation": observations * scale})[0]
    assert found == pytest.approx(expected, abs=1e-5)


def test_act_in_the_file_and_in_training_agree(static: Exported, scan) -> None:
    one, two = OnnxPolicy(static.path), greedy_policy(static.policy, static.layout, 0.1)
    for k in range(5):
        goal, velocity = (3.0 - 0.5 * k, 0.4 * k - 1.0), (0.1 * k, -0.2 * k)
        first, second = one.act(scan, goal, velocity), two.act(scan, goal, velocity)
        assert first == pytest.approx(second, abs=1e-5)


def test_one_robot_and_many(static: Exported) -> None:
    rng = np.random.default_rng(2)
    scans = rng.uniform(0.2, 4.0, (7, 360)).astype(np.float32)
    goals, velocities = rng.uniform(-3, 3, (7, 2)), rng.uniform(-0.2, 0.5, (7, 2))
    many = OnnxPolicy(static.path)
    singles = [OnnxPolicy(static.path) for _ in range(7)]
    # Twice, because the second answer depends on the first.
    for _ in range(2):
        together = many.act(scans, goals, velocities)
        assert together.shape == (7, 2)
        assert together.dtype == np.float64
        for i, single in enumerate(singles):
            alone = single.act(scans[i].tolist(), tuple(goals[i]), velocities[i])
            assert alone.shape == (2,)
            assert alone == pytest.approx(together[i], abs=1e-6)


def test_last_action_is_remembered_until_reset(static: Exported, scan) -> None:
    policy = OnnxPolicy(static.path)
    first, second = (policy.act(scan, (2.0, 1.0), ZERO) for _ in range(2))
    assert first.tolist() != second.tolist()
    policy.reset()
    assert policy.act(scan, (2.0, 1.0), ZERO).tolist() == first.tolist()


def test_goal_is_taken_as_x_forward_y_left(static: Exported, scan) -> None:
    seen = []
    policy = greedy_policy(static.policy, static.layout, 0.1)
    network = policy._network
    policy._network = lambda batch: seen.append(batch[0]) or network(batch)
    policy.act(scan, (0.0, 2.0), (0.3, -0.7))
    # 36 sectors; then 2 m away, at 90 degrees to the left: sine 1, cosine 0; then v and w.
    assert seen[0][36:41] == pytest.approx([2.0, 1.0, 0.0, 0.3, -0.7], abs=1e-6)
    assert seen[0][41:].tolist() == [0.0, 0.0]


def test_scan_by_rep_117_is_accepted(static: Exported, scan) -> None:
    policy = OnnxPolicy(static.path)
    scan[:4] = NAN, INF, -INF, 0.0
    assert np.isfinite(policy.act(scan, (1.0, 0.0), ZERO)).all()
    for whole in (INF, -INF, 99.0):
        policy.reset()
        assert np.isfinite(policy.act(np.full(360, whole), (1.0, 0.0), ZERO)).all()


def test_a_zero_is_what_the_robots_lidar_means_by_it(static: Exported, scan) -> None:
    def answer(value: float, zero_means: str) -> list[float]:
        policy = OnnxPolicy(static.path, other_robot(lidar={"zero_means": zero_means}))
        ranges = scan.copy()
        ranges[100:140] = value
        return policy.act(ranges, (1.0, 0.0), ZERO).tolist()

    assert answer(0.0, "no_return") == answer(0.0, "invalid") == answer(INF, "invalid")
    assert answer(0.0, "too_close") == answer(-INF, "invalid") != answer(INF, "invalid")
    # A lidar that says so by zeros may see nothing at all.
    policy = OnnxPolicy(static.path, other_robot(lidar={"zero_means": "no_return"}))
    free = OnnxPolicy(static.path).act(np.full(360, INF), (1.0, 0.0), ZERO)
    assert policy.act(np.zeros(360), (1.0, 0.0), ZERO).tolist() == free.tolist()


def test_the_file_knows_what_a_zero_means(static: Exported, tmp_path: Path) -> None:
    scan = replace(static.layout.scan, zero_means="too_close")
    metadata = OnnxPolicy(static.path).metadata
    metadata["observation"] = replace(static.layout, scan=scan).to_dict()
    path = rewrite(static, tmp_path / "other.onnx", metadata)
    assert OnnxPolicy(path).layout.scan.zero_means == "too_close"
    # Files of before say nothing of it.
    del metadata["observation"]["scan"]["zero_means"]
    rewrite(static, path, metadata)
    assert OnnxPolicy(path).layout.scan.zero_means == "invalid"
    metadata["observation"]["scan"]["zero_means"] = "free"
    rewrite(static, path, metadata)
    with pytest.raises(InputError, match="zero_means = 'free': unknown; allowed: no_return"):
        OnnxPolicy(path)


def test_nan_and_discarded_ranges_read_like_no_return(static: Exported, scan) -> None:
    answers = []
    for value in (INF, NAN, 0.05, 3.6):
        scan[100:140] = value
        policy = OnnxPolicy(static.path)
        answers.append(policy.act(scan, (1.0, 0.0), ZERO).tolist())
    assert answers[1:] == answers[:1] * 3
    scan[100:140] = -INF
    assert OnnxPolicy(static.path).act(scan, (1.0, 0.0), ZERO).tolist() != answers[0]


@pytest.mark.parametrize(
    ("scan", "message"),
    [
        (np.ones(359), r"shape \(359,\): this policy needs 360 ranges"),
        (np.ones((2, 361)), r"shape \(2, 361\): this policy needs 360"),
        (np.ones(0), "needs 360 ranges"),
        (np.float32(1.0), "needs 360 ranges"),
        (np.full(360, NAN), "every range is NaN"),
        (np.zeros(360), r"every range is NaN, 0 or [^\n]* set lidar.zero_means"),
        (np.full(360, 0.05), "every range is NaN, 0 or below range_min"),
        (np.concatenate([np.ones(5), [-0.5], np.ones(354)]), r"scan\[5\] = -0.5"),
    ],
)
def test_wrong_scan_is_refused(static: Exported, scan, message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        OnnxPolicy(static.path).act(scan, (1.0, 0.0), ZERO)
    assert "\n" not in str(raised.value)


def test_one_blind_robot_among_many_is_noticed(static: Exported) -> None:
    scans = np.ones((3, 360))
    scans[1] = NAN
    with pytest.raises(InputError, match="every range is NaN"):
        OnnxPolicy(static.path).act(scans, np.ones((3, 2)), np.zeros((3, 2)))


@pytest.mark.parametrize("bad", [(NAN, 0.0), (0.0, INF), (1.0,), (1.0, 2.0, 3.0), 1.0])
@pytest.mark.parametrize("which", ["goal", "velocity"])
def test_wrong_goal_or_velocity_is_refused(static: Exported, scan, bad, which: str) -> None:
    pair = {"goal": (1.0, 0.0), "velocity": ZERO} | {which: bad}
    with pytest.raises(InputError, match=rf"^{which} = [^\n]*: must be two finite numbers$"):
        OnnxPolicy(static.path).act(scan, **pair)


def test_metadata_is_complete(static: Exported) -> None:
    metadata = OnnxPolicy(static.path).metadata
    assert metadata["robot"] == "pm01"
    assert metadata["task"] == "static"
    assert metadata["control_dt"] == 0.1
    assert metadata["lidar_mount"] == [0.0, 0.0, 0.0]
    assert metadata["footprint_radius"] == 0.17
    assert OnnxPolicy(static.path).layout == static.layout
    assert OnnxPolicy(static.path).control_dt == 0.1


def test_unreadable_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.onnx: cannot be read: No such file"):
        OnnxPolicy(tmp_path / "none.onnx")
    with pytest.raises(InputError, match="cannot be read"):
        OnnxPolicy(tmp_path)
    for content in (b"", b"garbage", bytes(range(256)) * 40):
        path = tmp_path / "garbage.onnx"
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"^[^\n]*garbage\.onnx: [^\n]*$"):
            OnnxPolicy(path)


def test_cut_off_file_is_refused(static: Exported, tmp_path: Path) -> None:
    path = tmp_path / "half.onnx"
    path.write_bytes(static.path.read_bytes()[: static.path.stat().st_size // 2])
    with pytest.raises(InputError, match=r"^[^\n]*half\.onnx: [^\n]*$"):
        OnnxPolicy(path)


def test_file_without_metadata_is_refused(static: Exported, tmp_path: Path) -> None:
    path = rewrite(static, tmp_path / "bare.onnx", None, remove=True)
    with pytest.raises(InputError, match=r"^[^\n]*bare\.onnx: has no pm01_nav metadata[^\n]*$"):
        OnnxPolicy(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": 99}, "metadata format is 99, this version reads 1"),
        ({"format": None}, "metadata format is None"),
        ({"observation": {}}, "observation"),
        ({"observation": None}, "observation layout"),
        ({"control_dt": "soon"}, "metadata"),
        ({"control_dt": None}, "metadata"),
    ],
)
def test_foreign_metadata_is_refused(static: Exported, tmp_path: Path, change, message) -> None:
    metadata = OnnxPolicy(static.path).metadata | change
    path = rewrite(static, tmp_path / "other.onnx", metadata)
    with pytest.raises(InputError, match=message) as raised:
        OnnxPolicy(path)
    assert "\n" not in str(raised.value)


def test_metadata_that_is_no_json_is_refused(static: Exported, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not valid JSON"):
        OnnxPolicy(rewrite(static, tmp_path / "text.onnx", "{"))


@pytest.mark.parametrize("text", ["[]", "3", "null"])
def test_metadata_that_is_no_mapping_is_refused(static: Exported, tmp_path: Path, text) -> None:
    with pytest.raises(InputError):
        OnnxPolicy(rewrite(static, tmp_path / "list.onnx", text))


def test_fitting_robot_is_accepted(static: Exported) -> None:
    OnnxPolicy(static.path, load_robot("pm01"))


def other_robot(**changes: Any) -> RobotSpec:
    return validate(RobotSpec, merge(load_robot("pm01").model_dump(), changes), "test")


@pytest.mark.parametrize(
    ("group", "key", "value"),
    [
        ("lidar", "num_beams", 180),
        ("lidar", "angle_min", -3.0),
        ("lidar", "range_min", 0.2),
        ("lidar", "range_max", 2.0),
        ("lidar", "x", 0.1),
        ("lidar", "y", 0.1),
        ("lidar", "yaw", math.pi),
        ("limits", "linear_max", 0.4),
        ("limits", "linear_min", 0.0),
        ("limits", "angular_max", 1.0),
    ],
)
def test_other_robot_is_refused(static: Exported, group: str, key: str, value: float) -> None:
    robot = other_robot(**{group: {key: value}})
    with pytest.raises(InputError, match=rf"does not fit robot pm01: {group}\.[^\n]*$") as raised:
        OnnxPolicy(static.path, robot)
    assert "\n" not in str(raised.value)


def test_wider_robot_is_refused(static: Exported) -> None:
    with pytest.raises(InputError, match="does not fit robot pm01: footprint"):
        OnnxPolicy(static.path, other_robot(footprint={"radius": 0.3}))


def test_jackal_is_refused(static: Exported) -> None:
    with pytest.raises(InputError, match="does not fit robot jackal"):
        OnnxPolicy(static.path, load_robot("jackal"))


def test_running_a_policy_loads_no_simulator_and_no_learner(static: Exported) -> None:
    program = (
        "import sys, numpy as np\n"
        "from pm01_nav.policy import OnnxPolicy\n"
        f"OnnxPolicy({str(static.path)!r}).act(np.ones(360), (1.0, 0.0), (0.0, 0.0))\n"
        "heavy = {'torch', 'gymnasium', 'numba', 'pydantic', 'yaml', 'stable_baselines3'}\n"
        "print(sorted(heavy & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"
