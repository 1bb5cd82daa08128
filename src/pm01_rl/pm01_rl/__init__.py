# SPDX-License-Identifier: Apache-2.0
"""ROS 2 nodes around ``pm01_nav``: they convert messages, call it, and publish."""
