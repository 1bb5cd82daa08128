# SPDX-License-Identifier: Apache-2.0
"""The batched planar simulator."""
