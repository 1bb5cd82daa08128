# SPDX-License-Identifier: Apache-2.0
"""Robots in Gazebo Harmonic: in servers of our own, stepped in lockstep, or in one that runs."""
