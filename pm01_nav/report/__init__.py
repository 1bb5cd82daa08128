# SPDX-License-Identifier: Apache-2.0
"""A benchmark's results as one HTML file that needs nothing else."""
