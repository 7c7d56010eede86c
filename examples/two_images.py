#!/usr/bin/env python3

# Copyright 2026 Seed 64efc911 maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Calibrate from one pair of images, and say what the uncertainty is made of.

    python examples/two_images.py left.png right.png rig.yaml

The images are rectified. The rig file has `width, height, fx, fy, cx, cy, baseline_m`, in pixels and metres.
"""

import argparse
import math
import sys
from pathlib import Path

import cv2
import numpy as np
import yaml

from stereo_selfcal import StereoRig, calibrate


def main() -> int:
    """Calibrate and print; the status is 1 where the pair is refused."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("left", type=Path)
    parser.add_argument("right", type=Path)
    parser.add_argument("rig", type=Path)
    arguments = parser.parse_args()

    rig = StereoRig(**yaml.safe_load(arguments.rig.read_text(encoding="utf-8")))
    images = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in (arguments.left, arguments.right)]
    result = calibrate(*images, rig)

    print(result.message)  # the calibration; or what was measured, the limit and what to do
    if not result.accepted:
        print(f"reason: {result.reason}")  # a word that programs may compare
        return 1

    pose, std = result.extrinsics, result.std  # metres and radians
    print(f"height  {pose.height_m:.3f} m    +- {std.height_m:.3f}")
    print(f"pitch  {math.degrees(pose.pitch_rad):+.3f} deg  +- {math.degrees(std.pitch_rad):.3f}")
    print(f"roll   {math.degrees(pose.roll_rad):+.3f} deg  +- {math.degrees(std.roll_rad):.3f}")

    # The covariance is a sum of terms, one for each cause. A drive averages the motion of the car.
    for term in sorted(result.uncertainty, key=lambda each: -each.covariance[1, 1]):
        height_std_m, pitch_std_rad, _ = np.sqrt(np.diag(term.covariance))
        pitch_std_deg = math.degrees(pitch_std_rad)
        print(f"  {term.name:<16}{1e3 * height_std_m:8.2f} mm {pitch_std_deg:8.4f} deg of pitch")
    return 0


if __name__ == "__main__":
    sys.exit(main())
