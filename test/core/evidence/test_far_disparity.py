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

"""The disparity of what is farthest away, on skylines whose disparity is known."""

import cv2
import numpy as np
import pytest

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.evidence.far_disparity import FarDisparity, far_disparity
from stereo_selfcal.core.geometry.homography import horizon_row
from stereo_selfcal.core.rejection import NotFitted
from stereo_selfcal.synth.scenes import PAPER_RIG

RIG = PAPER_RIG
POSE = Extrinsics(1.4, 0.05, 0.0)
SKY, LAND = 190.0, 70.0


def skyline(disparity_of, rng, noise=1.0, contrast=12.0):
    """Return both images of hills with a texture before a plain sky; below the horizon is plain land.

    Args:
        disparity_of: Function of the column that returns the disparity of the hills there [px].
        rng: Noise, hills and texture.
        noise: Standard deviation of the noise.
        contrast: Standard deviation of the texture.
    """
    horizon = horizon_row(RIG, POSE, RIG.cx)
    size = RIG.height, RIG.width
    texture = cv2.GaussianBlur(rng.normal(0.0, 1.0, size), (0, 0), 1.5)
    hills = cv2.GaussianBlur(rng.normal(0.0, 1.0, (1, RIG.width)), (0, 0), 6.0)[0]
    top = horizon - 20.0 + 6.0 * hills / hills.std()
    above = np.clip(np.arange(RIG.height)[:, None] - top + 0.5, 0.0, 1.0)
    land = LAND + contrast * texture / texture.std() * (np.arange(RIG.height)[:, None] < horizon)
    picture = (SKY + above * (land - SKY)).astype(np.float32)
    u, v = np.meshgrid(np.arange(RIG.width, dtype=np.float32), np.arange(RIG.height, dtype=np.float32))
    # A column u of the right image shows what is at u + d of the left one.
    moved = cv2.remap(picture, u + disparity_of(u), v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    images = [each + rng.normal(0.0, noise, size) for each in (picture, moved)]
    return tuple(np.clip(np.rint(each), 0, 255).astype(np.uint8) for each in images)


@pytest.mark.parametrize("disparity", [-2.6, -0.8, 0.0, 0.35, 1.9])
@pytest.mark.parametrize("seed", range(3))
def test_hills_at_infinity_show_its_disparity(disparity, seed):
    images = skyline(lambda u: np.full_like(u, disparity), np.random.default_rng(seed))
    found = far_disparity(images, RIG, POSE)
    assert abs(found.disparity_px - disparity) < 3.0 * found.std_px
    assert found.std_px < 0.2
    assert found.n_equal > 6.0  # of 16 directions


def test_wrong_row_of_the_horizon_does_not_matter():
    """By a degree: what a turned camera does to a pose."""
    images = skyline(lambda u: np.full_like(u, -1.5), np.random.default_rng(1))
    for pitch_rad in (POSE.pitch_rad - 0.018, POSE.pitch_rad + 0.018):
        found = far_disparity(images, RIG, Extrinsics(1.4, pitch_rad, 0.0))
        assert abs(found.disparity_px + 1.5) < 3.0 * found.std_px


@pytest.mark.parametrize("seed", range(3))
def test_houses_at_all_distances_are_not_equal(seed):
    """The least disparity of a street that closes the view: it is positive, and no two directions agree."""
    images = skyline(lambda u: 0.5 + 3.5 * u / RIG.width, np.random.default_rng(seed))
    found = far_disparity(images, RIG, POSE)
    assert found.disparity_px > 0.5
    assert found.n_equal < 2.5


def test_farthest_of_several_distances_counts():
    """Trees near by on three quarters of the width, hills at infinity on the rest."""
    images = skyline(
        lambda u: np.where(u < 0.7 * RIG.width, 3.0, 0.0).astype(np.float32), np.random.default_rng(2)
    )
    found = far_disparity(images, RIG, POSE)
    assert abs(found.disparity_px) < 3.0 * found.std_px
    assert found.n_equal >= 3.0


def test_nothing_is_seen_in_a_plain_sky_or_in_noise():
    plain = np.full((RIG.height, RIG.width), 120, np.uint8)
    assert isinstance(far_disparity((plain, plain), RIG, POSE), NotFitted)
    rng = np.random.default_rng(0)
    noise = tuple(rng.integers(0, 256, plain.shape, np.uint8) for _ in range(2))
    assert isinstance(far_disparity(noise, RIG, POSE), NotFitted)


def test_horizon_out_of_view_is_said():
    plain = np.full((RIG.height, RIG.width), 120, np.uint8)
    found = far_disparity((plain, plain), RIG, Extrinsics(1.4, 0.6, 0.0))
    assert isinstance(found, NotFitted)
    assert "in view" in found.reason


def test_large_images_are_measured_in_their_own_pixels():
    """Twice as many pixels, twice the disparity."""
    images = skyline(lambda u: np.full_like(u, -1.2), np.random.default_rng(4))
    rig = type(RIG)(1920, 1440, RIG.fx * 3, RIG.fy * 3, RIG.cx * 3 + 1, RIG.cy * 3 + 1, RIG.baseline_m)
    large = tuple(cv2.resize(each, (1920, 1440), interpolation=cv2.INTER_CUBIC) for each in images)
    found = far_disparity(large, rig, POSE)
    assert isinstance(found, FarDisparity)
    assert abs(found.disparity_px + 3.6) < 3.0 * found.std_px
