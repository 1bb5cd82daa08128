# SPDX-License-Identifier: Apache-2.0
"""What colcon installs of this package."""

from glob import glob

from setuptools import setup

setup(
    name="pm01_rl",
    version="0.1.0",
    packages=["pm01_rl"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/pm01_rl"]),
        ("share/pm01_rl", ["package.xml"]),
        ("share/pm01_rl/launch", glob("launch/*.launch.py")),
    ],
    zip_safe=True,
    maintainer="The PM01 Navigation authors",
    maintainer_email="pm01-nav@example.org",
    description="A learned policy as a ROS 2 node, and a simulated robot.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "policy_node = pm01_rl.policy_node:main",
            "sim_node = pm01_rl.sim_node:main",
            "watchdog_node = pm01_rl.watchdog_node:main",
            "train = pm01_rl.command_line:train",
            "evaluate = pm01_rl.command_line:evaluate",
        ]
    },
)
