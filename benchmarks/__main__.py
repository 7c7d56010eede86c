"""Measure everything and write it to benchmarks/results/results.md."""

from __future__ import annotations

import platform
import sys
from pathlib import Path

import cv2
import numpy as np

from .accuracy import noise_table, recorded_table, seed_table
from .speed import stage_table

RESULTS = Path(__file__).parent / "results" / "results.md"
# Real recordings may not be copied into the project; where they lie beside it they are measured too.
RECORDED = Path(__file__).resolve().parents[2] / "shared" / "data"


def main() -> int:
    """Run all benchmarks."""
    tables = [stage_table, noise_table, seed_table]
    if (RECORDED / "kitti_odometry02").is_dir():
        bag, reference = RECORDED / "kitti_odometry02", RECORDED / "kitti_odometry02_stereo_plane.csv"
        tables.append(lambda: recorded_table(bag, reference))
    versions = f"Python {platform.python_version()}, NumPy {np.__version__}, OpenCV {cv2.__version__}"
    text = f"# Measured by `make bench`\n\n{versions}, {platform.machine()}.\n"
    for table in tables:
        section = table().markdown()
        sys.stdout.write(f"\n{section}")
        sys.stdout.flush()
        text += f"\n{section}"
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
