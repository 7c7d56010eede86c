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

"""Stripe points: where they are put, what is no stripe, and how much noise is seen."""

from dataclasses import replace

import numpy as np
import pytest

from stereo_selfcal import CalibratorConfig, StereoRig, calibrate
from stereo_selfcal.core.config import ExtractionConfig
from stereo_selfcal.core.lanes.stripe_points import edge_response, find_stripe_points, noise_grey
from stereo_selfcal.synth.scenes import PAPER_RIG

CONFIG = ExtractionConfig()
DARK, BRIGHT = 80, 200
HEIGHT, WIDTH = 60, 400
# The paint's left edge, moving by a little more than a third of a pixel a row: every part of a pixel.
EDGES = 150 + 0.37 * np.arange(HEIGHT)
# Rounding to grey levels moves an edge of contrast 120 by up to 1 / 240 px; the rest is to spare.
SUB_PIXEL = 0.02


def covered(edges, width=WIDTH):
    """Return how much of each pixel, u - 0.5 ... u + 0.5, lies to the right of the edge in its row."""
    return np.clip(np.arange(width) + 0.5 - np.asarray(edges)[:, None], 0, 1)


def picture(share, dark=DARK, bright=BRIGHT):
    return np.rint(dark + (bright - dark) * share).astype(np.uint8)


def stripe(width_px, **grey):
    return picture(covered(EDGES) - covered(EDGES + width_px), **grey)


def noisy(image, sigma, seed=0):
    noise = sigma * np.random.default_rng(seed).standard_normal(image.shape)
    return np.rint(np.clip(image + noise, 0, 255)).astype(np.uint8)


def marked(image, **changes):
    return find_stripe_points(image, replace(CONFIG, **changes)).marked


@pytest.mark.parametrize("width_px", [4, 5.5, 8, 13, 20, 33, 47, 60])
def test_positive_edge_is_marked_to_a_fiftieth_of_a_pixel(width_px):
    points = marked(stripe(width_px))
    rows = points.rows.astype(int)
    assert np.abs(points.columns - EDGES[rows]).max() < SUB_PIXEL
    # Wide stripes are looked for in every second row.
    assert set(rows) >= set(range(0, HEIGHT, 2))


def test_thin_stripe_is_marked_by_the_papers_kernel():
    """Three pixels are the narrowest stripe whose far edge does not pull at the near one."""
    points = marked(stripe(3))
    error = np.abs(points.columns - EDGES[points.rows.astype(int)])
    assert set(points.rows[error < SUB_PIXEL]) == set(range(HEIGHT))


@pytest.mark.parametrize("width_px", [3, 5.5, 8, 13, 20, 33, 47, 60])
def test_width_is_measured(width_px):
    points = marked(stripe(width_px))
    error = np.abs(points.widths - width_px)
    # Whole pixels between peaks that are rounded themselves.
    assert set(points.rows[error <= 1.0]) >= set(range(0, HEIGHT, 2))
    # The next larger filter marks it too, and rounds it up to the least it looks for: 16 px instead of 13.
    assert error.max() <= 3.0


def test_slope_is_that_of_the_edge():
    points = marked(stripe(8))
    inner = (points.rows > 1) & (points.rows < HEIGHT - 2)
    # 3 x 3 pixels of an edge 0.37 px a row aslant: good to a tenth, which the Hough transform allows for.
    assert np.median(points.slopes[inner]) == pytest.approx(0.37, abs=0.1)
    mirrored = marked(stripe(8)[:, ::-1])
    assert np.median(mirrored.slopes) == pytest.approx(-0.37, abs=0.1)


def test_contrast_and_continuity_of_a_clean_stripe():
    points = marked(stripe(8))
    # The narrowest filters see the whole step, the widest half of it beyond the far edge.
    assert points.contrast.max() == pytest.approx(BRIGHT - DARK, abs=1)
    inner = (points.rows >= 4) & (points.rows < HEIGHT - 4)
    assert points.continuity[inner].min() == 1.0


def test_points_are_aligned_arrays():
    points = marked(stripe(8))
    names = ("rows", "columns", "widths", "contrast", "counts", "slopes", "slope_std", "continuity")
    assert len({getattr(points, name).shape for name in names}) == 1
    assert find_stripe_points(stripe(8), CONFIG).gradient.shape == (HEIGHT, WIDTH)


def test_dark_stripe_on_bright_is_not_marked():
    assert marked(stripe(8, dark=BRIGHT, bright=DARK)).rows.size == 0


@pytest.mark.parametrize("dark_to_bright", [True, False])
def test_lone_step_is_not_marked(dark_to_bright):
    share = covered(EDGES)
    assert marked(picture(share if dark_to_bright else 1 - share)).rows.size == 0


def test_step_beside_a_weaker_one_is_not_marked():
    """A kerb: 80 grey levels up, only 30 down again - less than half."""
    image = picture(covered(EDGES) - 0.375 * covered(EDGES + 6))
    assert marked(image).rows.size == 0
    # The same with half and a little more is a stripe on a two-coloured road.
    assert marked(picture(covered(EDGES) - 0.55 * covered(EDGES + 6))).rows.size > 0


def test_too_wide_a_band_is_not_marked():
    """The widest filter takes the mean of 16 px at up to 65 px: beyond 65 + 16 px it sees nothing fall."""
    assert marked(stripe(90)).rows.size == 0


@pytest.mark.parametrize(("contrast", "seen"), [(7, False), (10, True)])
def test_paint_has_eight_grey_levels_at_least(contrast, seen):
    assert (marked(stripe(8, dark=80, bright=80 + contrast)).rows.size > 0) is seen


def test_contrast_is_compared_with_the_noise():
    # Noise of 10: a mean of 4 px against a mean of 4 px has 7, so 3 sigma are 21 and 20 sigma are 141.
    image = noisy(stripe(12), 10.0)
    near = 4.0
    strict, usual = marked(image, min_contrast_sigma=20), marked(image)
    assert strict.rows.size == 0
    assert np.mean(np.abs(usual.columns - EDGES[usual.rows.astype(int)]) < near) > 0.5


def test_response_of_length_one_is_the_papers_kernel():
    image = np.random.default_rng(0).integers(0, 256, (5, 20), dtype=np.uint8)
    expected = image[:, 2:].astype(float) - image[:, :-2]
    np.testing.assert_array_equal(edge_response(image, 1)[:, 1:-1], expected)


@pytest.mark.parametrize("length", [2, 4, 8, 16])
def test_response_is_mean_right_minus_mean_left(length):
    image = np.random.default_rng(0).integers(0, 256, (5, 80), dtype=np.uint8)
    expected = np.zeros(image.shape)
    for u in range(length, 80 - length):
        right, left = image[:, u + 1 : u + 1 + length], image[:, u - length : u]
        expected[:, u] = right.mean(axis=1) - left.mean(axis=1)
    # float32 sums of 16 values up to 255.
    np.testing.assert_allclose(edge_response(image, length), expected, atol=1e-3)


@pytest.mark.parametrize("fraction", [0.01, 0.02, 0.05, 0.10, 0.15, 0.20])
def test_noise_of_a_road_is_measured_to_a_tenth(rendered, fraction):
    _, left, right = rendered(0, fraction)
    for image in (left, right):
        assert noise_grey(image) == pytest.approx(255 * fraction, rel=0.1)


def test_noise_is_not_lowered_by_a_white_sky():
    image = noisy(np.full((480, 640), 120.0), 12.0)
    image[:300] = 255
    assert noise_grey(image) == pytest.approx(12.0, rel=0.1)


@pytest.mark.parametrize("grey", [0, 255, 128])
def test_flat_image_has_the_noise_of_rounding(grey):
    assert noise_grey(np.full((100, 100), grey, np.uint8)) == 0.5


def refused(left, right, rig=PAPER_RIG):
    return not calibrate(left, right, rig).accepted


@pytest.mark.parametrize("sigma", [2.0, 40.0])
def test_pure_noise_is_never_calibrated(sigma):
    flat = np.full((480, 640), 120.0)
    for seed in range(10):
        left = noisy(flat, sigma, seed)
        assert refused(left, noisy(flat, sigma, 100 + seed))
        # The same noise with a disparity, as a textured wall would have.
        assert refused(left, np.roll(left, -10, axis=1))


def patterns(height, width):
    v, u = np.indices((height, width))
    yield "black", np.zeros((height, width))
    yield "white", np.full((height, width), 255.0)
    yield "to the right", 255.0 * u / width
    yield "downwards", 255.0 * v / height
    for size in (1, 8, 31):
        yield f"checkerboard {size}", 200.0 * ((u // size + v // size) % 2)
        yield f"vertical stripes {size}", 200.0 * (u // size % 2)
        yield f"slanted stripes {size}", 200.0 * ((u + v) // size % 2)


@pytest.mark.slow
@pytest.mark.parametrize("size", [(480, 640), (64, 64), (64, 1000), (1000, 65)])
def test_artificial_patterns_are_refused(size):
    height, width = size
    rig = StereoRig(width, height, 500.0, 500.0, (width - 1) / 2, (height - 1) / 2, 0.15)
    for name, image in patterns(height, width):
        left = image.astype(np.uint8)
        assert refused(left, left, rig), name
        assert refused(left, np.roll(left, -7, axis=1), rig), name


def test_extraction_settings_are_used():
    assert CalibratorConfig().extraction == CONFIG


def test_points_within_limits_are_those_of_the_whole_image_there():
    """Where the neighbourhood of a point is within, too, nothing of it differs."""
    image = noisy(stripe(8), 5.0)
    limits = np.full(HEIGHT, 100.0), np.full(HEIGHT, 250.0)
    points = find_stripe_points(image, CONFIG)
    part, whole = points.within(limits).marked, points.marked
    inside = (whole.columns >= 101) & (whole.columns <= 249)
    assert 0 < len(part.rows) < len(whole.rows)
    kept = part.chosen((part.columns >= 101) & (part.columns <= 249))
    for name in ("rows", "columns", "widths", "contrast", "slopes"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(whole.chosen(inside), name))
    assert points.within(limits) is points  # all of them are marked by now


@pytest.mark.parametrize(("height", "step"), [(480, 1), (800, 1), (1080, 2), (2048, 3)])
def test_large_images_are_looked_at_in_fewer_rows(height, step):
    """A line has as many points, each of which counts for its rows."""
    image = np.full((height, 300), DARK, np.uint8)
    image[:, 150:153] = BRIGHT
    points = marked(image)
    on_edge = np.abs(points.columns - 149.5) < 1.0
    assert set(np.diff(np.unique(points.rows[on_edge]))) == {step}
    assert points.counts[on_edge].min() == step
    assert points.continuity[on_edge].mean() > 0.95
