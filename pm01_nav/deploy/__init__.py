# SPDX-License-Identifier: Apache-2.0
"""What a robot needs around a policy. Driving needs numpy and onnxruntime, nothing ROS."""
