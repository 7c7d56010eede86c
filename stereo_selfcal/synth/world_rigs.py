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

"""Rigs that worlds are seen with, and where each is mounted."""

from __future__ import annotations

from typing import NamedTuple

from ..core.camera.rig import StereoRig
from .scenes import PAPER_RIG


class Mount(NamedTuple):
    """A rig and the poses it is drawn with.

    Attributes:
        rig: The rectified pair.
        height_m: Least and greatest height over the road [m].
        pitch_deg: Least and greatest pitch [deg], > 0: nose down.
    """

    rig: StereoRig
    height_m: tuple[float, float] = (0.8, 2.2)
    pitch_deg: tuple[float, float] = (-3.0, 8.0)


RIGS: dict[str, Mount] = {
    "paper": Mount(PAPER_RIG),
    "kitti": Mount(StereoRig(1242, 375, 721.5, 721.5, 609.6, 172.9, 0.537)),
    "hd": Mount(StereoRig(1280, 720, 700.0, 700.0, 639.5, 359.5, 0.30)),
    # The short baselines of cameras sold as one device: 7.5 cm as an OAK-D, 12 cm as a ZED.
    "short": Mount(StereoRig(1280, 800, 800.0, 800.0, 637.2, 402.8, 0.075)),
    "compact": Mount(StereoRig(1280, 720, 705.0, 705.0, 645.1, 355.3, 0.12)),
    # A delivery robot: lines are narrow in its rows, and kerbs are as high as half its mast.
    "robot": Mount(StereoRig(640, 400, 405.0, 405.0, 321.3, 198.1, 0.10), (0.4, 0.6), (-2.0, 6.0)),
    # Behind the windscreen of a lorry.
    "truck": Mount(StereoRig(960, 600, 690.0, 690.0, 478.2, 303.9, 0.25), (2.5, 3.0), (2.0, 9.0)),
    "full_hd": Mount(StereoRig(1920, 1080, 910.0, 910.0, 957.3, 544.6, 0.30)),
}
