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

"""The values a synthetic scene is made of refuse what cannot be rendered."""

import math

import pytest

from stereo_selfcal.core.camera.rig import StereoRig
from stereo_selfcal.core.errors import ConfigError
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.synth.world import LaneLine, Photometry, Road, Scene, Verge

RIG = StereoRig(64, 48, 51.66, 51.66, 31.5, 23.5, 0.1481)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: LaneLine(0.0, width_m=0.0), "width_m"),
        (lambda: LaneLine(math.nan), "offset_m is nan"),
        (lambda: LaneLine(0.0, dash_m=3.0), "belong together"),
        (lambda: LaneLine(0.0, dash_m=3.0, gap_m=0.0), "gap_m"),
        (lambda: LaneLine(0.0, dash_m=-3.0, gap_m=1.0), "dash_m"),
        (lambda: Road(lines=(LaneLine(1.0), LaneLine(1.1))), "overlap"),
        (lambda: Road(lines=(LaneLine(10.0),), curvature_per_m=0.1), "has a radius"),
        (lambda: Road(lines=(), curvature_per_m=math.inf), "curvature_per_m is inf"),
        (lambda: Road(texture_amplitude=-1.0), "texture_amplitude"),
        (lambda: Road(texture_seed=-1), "texture_seed"),
        (lambda: Road(verge=Verge(1.0, -3.0)), "on the asphalt"),
        (lambda: Verge(-1.0, 1.0), r"verge\.right_m"),
        (lambda: Photometry(gain=0.0), "gain"),
        (lambda: Photometry(vignetting=1.1), "vignetting"),
        (lambda: Photometry(psf_sigma_px=-1.0), "psf_sigma_px"),
        (lambda: Photometry(noise_fraction=-0.1), "noise_fraction"),
        (lambda: Scene(RIG, Extrinsics(0.05, 0.0, 0.0)), "height_m"),
        (lambda: Scene(RIG, Extrinsics(1.0, 0.0, 1.2)), "roll_rad"),
        (lambda: Scene(RIG, Extrinsics(1.0, 0.0, 0.0), lateral_offset_m=math.nan), "lateral_offset_m"),
    ],
)
def test_impossible_values_are_named(make, match):
    with pytest.raises(ConfigError, match=match):
        make()


def test_noise_of_both_cameras_is_set_at_once():
    scene = Scene(RIG, Extrinsics(1.0, 0.0, 0.0), right=Photometry(gain=2.0)).with_noise(0.1)
    assert (scene.left.noise_fraction, scene.right.noise_fraction, scene.right.gain) == (0.1, 0.1, 2.0)
    assert scene.photometry("right") is scene.right
    assert scene.photometry("left") is scene.left
