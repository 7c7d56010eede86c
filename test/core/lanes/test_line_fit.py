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

"""Lines: signs of the Hough transform, accuracy of the fit, its covariance, and outliers."""

import numpy as np
import pytest
from independent_camera import CAMERAS, image_line

from stereo_selfcal.core.config import ExtractionConfig
from stereo_selfcal.core.lanes.hough import PEAKS_PER_SIGN, hough_peaks
from stereo_selfcal.core.lanes.line_fit import fit_line, refit_line
from stereo_selfcal.core.lanes.stripe_points import edge_response, find_stripe_points
from stereo_selfcal.synth.renderer import render_camera
from stereo_selfcal.synth.scenes import random_scene
from stereo_selfcal.synth.world import LINE_WIDTH_M

CONFIG = ExtractionConfig()
# What is measured is the left edge of the paint.
LEFT_EDGES_M = (1.75 + LINE_WIDTH_M / 2, -1.75 + LINE_WIDTH_M / 2)
LEAST_NOISE = 0.5


def smooth_scene(seed):
    """Return a scene whose road surface has no texture, so that nothing displaces an edge."""
    return random_scene(np.random.default_rng(seed), texture_amplitude=0.0)


def as_image(picture):
    return np.rint(np.clip(picture, 0, 255)).astype(np.uint8)


def peaks_of(image):
    return hough_peaks(find_stripe_points(image, CONFIG), image.shape)


@pytest.fixture(scope="module")
def clean():
    """Return (picture, its right lane boundary's peak): one camera, no noise, no texture."""
    picture = render_camera(smooth_scene(0), "left")
    return picture, peaks_of(as_image(picture))[1][0]


@pytest.mark.parametrize("camera", [0, 1])
@pytest.mark.parametrize("seed", range(4))
def test_left_boundary_has_positive_theta_and_right_negative(rendered, seed, camera):
    """theta > 0 is a line that runs to the left going down: rho = u cos + v sin, so du/dv = -tan(theta)."""
    scene, *images = rendered(seed, 0.05)
    for peaks, sign, edge_m in zip(peaks_of(images[camera]), (-1, 1), LEFT_EDGES_M, strict=True):
        assert 1 <= len(peaks) <= PEAKS_PER_SIGN
        assert all(np.sign(peak.slope) == sign for peak in peaks)
        assert [peak.votes for peak in peaks] == sorted((peak.votes for peak in peaks), reverse=True)
        slope, at_0 = image_line(
            scene.rig, scene.extrinsics, CAMERAS[camera], edge_m, scene.lane_yaw_rad, scene.lateral_offset_m
        )
        best = peaks[0]
        # A cell is 4 px and 1 degree (0.03 in slope at 45 degrees); half of each to either side, doubled.
        assert abs(np.arctan(best.slope) - np.arctan(slope)) < np.radians(1.0)
        assert abs(best.u_mid - (at_0 + slope * best.v_mid)) < 4.0 * np.hypot(1, slope)


def test_no_points_give_no_lines():
    assert peaks_of(np.full((480, 640), 90, np.uint8)) == ([], [])


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("seed", range(4))
def test_fitted_line_is_the_projected_edge(seed, camera):
    scene = smooth_scene(seed)
    image = as_image(render_camera(scene, camera))
    for (peak, *_), edge_m in zip(peaks_of(image), LEFT_EDGES_M, strict=True):
        line = fit_line(edge_response(image, 1), peak, LEAST_NOISE)
        slope, at_0 = image_line(
            scene.rig, scene.extrinsics, camera, edge_m, scene.lane_yaw_rad, scene.lateral_offset_m
        )
        error = line.column_at(line.rows) - (at_0 + slope * line.rows)
        assert np.sqrt(np.average(error**2, weights=line.weights)) < 0.02
        # Its far end is a stripe of 2 px, the edges of which pull at each other.
        assert np.abs(error).max() < 0.04
        assert np.sign(line.slope) == np.sign(slope)


def test_covariance_is_that_of_many_draws_of_the_noise(clean):
    """Standard deviations within a factor of two: what a gate of three sigma can bear."""
    picture, peak = clean
    sigma, row, n_draws = 12.75, 350.0, 80
    rng = np.random.default_rng(0)
    drawn, claimed = [], []
    for _ in range(n_draws):
        image = as_image(picture + sigma * rng.standard_normal(picture.shape, dtype=np.float32))
        line = fit_line(edge_response(image, 1), peak, sigma)
        to_row = np.array([[1.0, row - line.v_mid], [0.0, 1.0]])
        drawn.append(to_row @ [line.u_mid, line.slope])
        claimed.append(to_row @ line.covariance @ to_row.T)
    # 80 draws give a standard deviation to 8 %.
    ratio = np.sqrt(np.diag(np.mean(claimed, axis=0))) / np.std(drawn, axis=0)
    assert np.all((ratio > 0.5) & (ratio < 2.0)), ratio


def test_v_mid_is_where_column_and_slope_are_least_correlated(clean):
    picture, peak = clean
    image = as_image(picture + 12.75 * np.random.default_rng(1).standard_normal(picture.shape))
    covariance = fit_line(edge_response(image, 1), peak, 12.75).covariance
    np.testing.assert_allclose(covariance, covariance.T)
    # Only the robust weights move the middle a little.
    assert abs(covariance[0, 1]) < 0.3 * np.sqrt(covariance[0, 0] * covariance[1, 1])


@pytest.mark.parametrize("places", ["together", "spread"])
def test_a_fifth_of_displaced_rows_does_not_move_the_line(clean, places):
    """Rows 3 px aside: inside the search window, so only the robust weights can tell."""
    picture, peak = clean
    image = as_image(picture)
    first, last = 272, 472  # rows in which this line is seen
    displaced = np.zeros(image.shape[0], dtype=bool)
    if places == "together":
        displaced[320:360] = True
    else:
        displaced[first:last] = np.arange(last - first) % 20 < 4
    assert displaced.sum() == (last - first) // 5
    bad = np.where(displaced[:, None], np.roll(image, 3, axis=1), image)
    line, reference = (fit_line(edge_response(i, 1), peak, LEAST_NOISE) for i in (bad, image))
    rows = np.arange(first, last)
    moved = line.column_at(rows) - reference.column_at(rows)
    # An average moves by a fifth of 3 px. RowBlocks of rows that are displaced in part cannot be told from
    # others at once: a third of that is what may remain; whole blocks are left out for good.
    assert np.abs(moved).max() < (0.05 if places == "together" else 0.2)
    # The displaced rows do not count, so less is known.
    assert line.covariance[0, 0] > 1.25 * reference.covariance[0, 0]


def test_refit_leaves_out_what_lies_above(clean):
    picture, peak = clean
    gradient = edge_response(as_image(picture), 1)
    line = fit_line(gradient, peak, LEAST_NOISE)
    again = refit_line(gradient, line, LEAST_NOISE, 349.2)
    assert line.rows.min() < 349.2 <= again.rows.min()
    np.testing.assert_allclose(again.column_at(again.rows), line.column_at(again.rows), atol=0.02)


def test_too_short_a_line_is_none(clean):
    picture, peak = clean
    gradient = edge_response(as_image(picture), 1)
    line = fit_line(gradient, peak, LEAST_NOISE)
    assert refit_line(gradient, line, LEAST_NOISE, len(picture) - 12) is None
    assert fit_line(np.zeros_like(gradient), peak, LEAST_NOISE) is None


def test_rows_count_image_rows(clean):
    picture, peak = clean
    line = fit_line(edge_response(as_image(picture), 1), peak, LEAST_NOISE)
    assert line.rows.shape == line.columns.shape == line.weights.shape
    assert line.n_rows == pytest.approx(line.rows.max() - line.rows.min(), abs=2 * 4)  # blocks of 4 rows
    assert line.weights.mean() == pytest.approx(1.0)
