# SPDX-License-Identifier: Apache-2.0
"""Measure policies and planners on worlds they have never seen."""
