"""These tests need ROS in an environment of its own: only `make ros` collects them."""

from __future__ import annotations

import os

collect_ignore_glob = [] if os.environ.get("FMFTS_ROS") else ["test_*.py"]
