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

"""Calibrate from a recorded drive frame by frame, and stop when the mount is known well enough.

    python examples/drive.py bags/straight_road --pitch-std-deg 0.15

It is what `replay --until-good` does, in a loop of your own: change what is done with each frame.
"""

import argparse
import math
import sys
from pathlib import Path

from stereo_selfcal import Calibrator, SelfcalError
from stereo_selfcal.offline import open_source


def main() -> int:
    """Read the drive and print; the status is 1 where no frame is accepted, 2 where it cannot be read."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("recording", type=Path, nargs="+", help="bags, or a folder of image pairs")
    parser.add_argument("--pitch-std-deg", type=float, default=0.12, help="what is good enough")
    arguments = parser.parse_args()

    try:
        with open_source(arguments.recording) as source:
            calibrator = Calibrator(source.rig)
            for frame in source.frames():
                result = calibrator.add(frame.left, frame.right, frame.stamp_s)
                if not result.accepted:
                    print(f"{frame.stamp_s:.3f} s  {result.reason}")
                    continue
                # One frame is the road at one moment; the estimate is the mount, over all frames so far.
                mount = calibrator.estimate
                pitch_deg, std_deg = (
                    math.degrees(mount.extrinsics.pitch_rad),
                    math.degrees(mount.std.pitch_rad),
                )
                print(f"{frame.stamp_s:.3f} s  pitch {pitch_deg:+.3f} deg +- {std_deg:.3f}")
                if std_deg <= arguments.pitch_std_deg:
                    break
    except SelfcalError as error:
        print(error, file=sys.stderr)
        return 2

    mount = calibrator.estimate
    print(mount.message)
    if mount.travel is not None and mount.travel.tells_yaw:
        print(mount.travel.describe_yaw())
    return 0 if mount.accepted else 1


if __name__ == "__main__":
    sys.exit(main())
