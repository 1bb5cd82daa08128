"""Environment steps per second of JaxNav (JaxMARL): one agent, one 2D lidar, on the CPU.

JaxMARL is no dependency of this package. Install it in a virtual environment of its own:

    python -m venv jaxnav-env
    jaxnav-env/bin/pip install jaxmarl==0.2.0
    JAX_PLATFORMS=cpu jaxnav-env/bin/python benchmarks/peers/jaxnav_steps.py --beams 20

One step is one step of one of the vectorised environments; compilation is not timed. The result
is one line of JSON, the last on standard output, for the fastest of the batch sizes tried.
"""

import argparse
import json
import statistics
import time
from functools import partial
from importlib.metadata import version
from typing import Any

import jax  # pyright: ignore[reportMissingImports]
import jax.numpy as jnp  # pyright: ignore[reportMissingImports]
from jaxmarl.environments.jaxnav import JaxNav  # pyright: ignore[reportMissingImports]

RADIUS_M, RANGE_M, STEP_S, MAX_V, MAX_W, MAX_STEPS, CHUNK = 0.17, 3.5, 0.1, 0.5, 1.5, 500, 32
LOW, HIGH = jnp.array([0.0, -MAX_W]), jnp.array([MAX_V, MAX_W])
FRESH = "a new map by the library's step(), which samples one at every step"
RESETS = {"fresh": FRESH, "bank": "a map, after step_env(), from a bank sampled before the clock"}
CONDITIONS = (
    f"10 m square of 1 m cells, 0-24 filled; square robot of side {2 * RADIUS_M} m; lidar 360 deg, "
    f"{RANGE_M} m in 0.05 m samples; {STEP_S} s step; random actions; at episode end, "
)


def make_env(beams: int) -> Any:
    """Builds one JaxNav environment close to a 10 m room with 12 obstacles."""
    room: dict[str, Any] = {"map_size": (12, 12), "fill": 0.25, "max_dist_to_goal": 8.0}
    room["agent_coords"] = RADIUS_M * jnp.array([[-1, -1], [-1, 1], [1, 1], [1, -1]])
    lidar = {"lidar_num_beams": beams, "lidar_max_range": RANGE_M}
    lidar["lidar_angle_factor"] = 1 - 1 / beams  # of a full circle: both end beams are included
    robot = {"rad": RADIUS_M, "max_v": MAX_V, "max_w": MAX_W, "max_steps": MAX_STEPS, "dt": STEP_S}
    return JaxNav(num_agents=1, map_params=room, **lidar, **robot)


def make_rollout(env: Any, num_envs: int, reset: str) -> tuple[Any, Any]:
    """Returns a jitted ``CHUNK`` of random steps and its first carry."""
    bank = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.PRNGKey(1), num_envs))

    def body(carry: Any, _: None) -> tuple[Any, None]:
        key, _, state, total = carry  # a result that is not carried would not be computed
        key, key_act, key_env, key_bank = jax.random.split(key, 4)
        action = {"agent_0": jax.random.uniform(key_act, (num_envs, 2), minval=LOW, maxval=HIGH)}
        step = jax.vmap(env.step if reset == "fresh" else env.step_env)
        obs, state, reward, done, _ = step(jax.random.split(key_env, num_envs), state, action)
        if reset == "bank":
            rows = jax.random.randint(key_bank, (num_envs,), 0, num_envs)
            pick = partial(jax.vmap(jnp.where), done["__all__"])
            obs, state = jax.tree.map(lambda x, y: pick(x[rows], y), bank, (obs, state))
        return (key, obs, state, total + reward["agent_0"].sum()), None

    rollout = jax.jit(lambda carry: jax.lax.scan(body, carry, None, length=CHUNK)[0])
    return rollout, (jax.random.PRNGKey(0), *bank, jnp.zeros(()))


def measure(num_envs: int, args: argparse.Namespace) -> dict[str, Any]:
    """Returns the steps per wall and per CPU second of every repeat at one batch size."""
    rollout, carry = make_rollout(make_env(args.beams), num_envs, args.reset)
    carry, rates = jax.block_until_ready(rollout(rollout(carry))), []  # compiles
    for _ in range(args.repeats):
        steps, cpu, wall = 0, time.process_time(), time.perf_counter()
        while time.perf_counter() - wall < args.seconds:
            carry = jax.block_until_ready(rollout(carry))
            steps += CHUNK * num_envs
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        rates.append((round(steps / wall), round(steps / cpu)))
    by_wall, by_cpu = zip(*rates, strict=True)
    result = {"env_steps_per_s": statistics.median(by_wall), "repeats": by_wall}
    result |= {"env_steps_per_cpu_s": statistics.median(by_cpu), "cpu_repeats": by_cpu}
    return result | {"beams": args.beams, "num_envs": num_envs}


def main() -> None:
    """Measures every batch size and prints the fastest."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    for flag, default in (("--beams", 20), ("--repeats", 5), ("--seconds", 2.5)):
        parser.add_argument(flag, type=type(default), default=default)
    parser.add_argument("--num-envs", type=int, nargs="+", default=[64, 256, 1024])
    parser.add_argument("--reset", choices=RESETS, default="fresh", help="how an episode restarts")
    args = parser.parse_args()
    runs = [measure(num_envs, args) for num_envs in args.num_envs]
    result: dict[str, Any] = {"name": "jaxnav", "version": version("jaxmarl")}
    result |= max(runs, key=lambda run: run["env_steps_per_s"])
    result["by_num_envs"] = {run["num_envs"]: run["env_steps_per_s"] for run in runs}
    result |= {"jax": jax.__version__, "device": jax.devices()[0].platform, "reset": args.reset}
    print(json.dumps(result | {"conditions": CONDITIONS + RESETS[args.reset]}))


if __name__ == "__main__":
    main()
