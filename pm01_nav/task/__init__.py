# SPDX-License-Identifier: Apache-2.0
"""The navigation task: what a robot sees, is paid for, and when an episode ends."""
