# SPDX-License-Identifier: Apache-2.0
"""Places to drive in: generators, readers, pools and free space."""
