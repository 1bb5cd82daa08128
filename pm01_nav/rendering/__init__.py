# SPDX-License-Identifier: Apache-2.0
"""Pictures, films, windows and plots."""
