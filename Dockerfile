# syntax=docker/dockerfile:1
# SPDX-License-Identifier: Apache-2.0
# Training, Gazebo Harmonic and ROS 2 Humble together; see docs/guide/gazebo.md.
FROM ros:humble-ros-base-jammy AS base
SHELL ["/bin/bash", "-eo", "pipefail", "-c"]
ENV DEBIAN_FRONTEND=noninteractive
RUN apt-get update \
    && apt-get install -y --no-install-recommends ca-certificates curl \
    && curl -fsSL https://packages.osrfoundation.org/gazebo.gpg -o /usr/share/keyrings/gazebo.gpg \
    && echo "deb [arch=$(dpkg --print-architecture) signed-by=/usr/share/keyrings/gazebo.gpg] https://packages.osrfoundation.org/gazebo/ubuntu-stable jammy main" \
        > /etc/apt/sources.list.d/gazebo.list \
    && apt-get update \
    && apt-get install -y --no-install-recommends \
        git gz-harmonic libegl1 libgl1-mesa-dri make \
        python3-gz-math7 python3-gz-msgs10 python3-gz-sim8 python3-gz-transport13 python3-venv \
        ros-humble-nav2-msgs ros-humble-rmw-cyclonedds-cpp ros-humble-robot-state-publisher \
        ros-humble-ros-gzharmonic ros-humble-rosbridge-server ros-humble-xacro \
    && rm -rf /var/lib/apt/lists/*
# Ubuntu 22.04 compiles Gazebo's messages for a protobuf older than the one that pip brings.
ENV RMW_IMPLEMENTATION=rmw_cyclonedds_cpp \
    ROS_LOCALHOST_ONLY=1 \
    GZ_IP=127.0.0.1 \
    PROTOCOL_BUFFERS_PYTHON_IMPLEMENTATION=python \
    PATH=/opt/pm01/bin:$PATH
RUN useradd --create-home pm01 && mkdir -p /opt/pm01 /work && chown pm01 /opt/pm01 /work
USER pm01
WORKDIR /work
# Gazebo's and ROS's Python packages are the system's.
RUN python3 -m venv --system-site-packages /opt/pm01 \
    && pip install --no-cache-dir --index-url https://download.pytorch.org/whl/cpu "torch==2.*"
COPY --chown=pm01 pyproject.toml constraints.txt README.md LICENSE ./
COPY --chown=pm01 pm01_nav pm01_nav
COPY --chown=pm01 src src
COPY --chown=pm01 colcon_defaults.yaml ./

FROM base AS test
COPY --chown=pm01 . .
RUN pip install --no-cache-dir -e '.[dev]' \
    && source /opt/ros/humble/setup.bash && colcon build
CMD ["bash", "-c", "source install/setup.bash && pytest -m 'gazebo or ros'"]

FROM base AS run
RUN pip install --no-cache-dir '.[train,viz,dds]' \
    && source /opt/ros/humble/setup.bash && colcon build
COPY --chown=pm01 docker/start.sh /usr/local/bin/start.sh
CMD ["start.sh"]
