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

"""What blocks of rows say of a stripe: on images of the model itself, made by integration over each pixel."""

import math
from functools import cache

import numpy as np
import pytest

from stereo_selfcal.core.estimators.row_blocks import BLOCK_ROWS, RAMP_PX, measure_blocks

WIDTH, N_BLOCKS = 240, 12
ROWS = 40 + np.arange(N_BLOCKS * BLOCK_ROWS).reshape(N_BLOCKS, BLOCK_ROWS)
MIDDLE = float(ROWS.mean())
HEIGHT = ROWS.max() + 1
# Left and right edge of two stripes in two cameras, in the middle row [px], and columns they move a row.
EDGES = np.array([[[62.3, 75.1], [150.4, 161.9]], [[54.7, 67.2], [141.6, 153.0]]])
SLOPES = np.array([[[-0.4, -0.3], [0.5, 0.62]], [[-0.45, -0.36], [0.41, 0.55]]])
GREYS = (80.0, 200.0, 90.0)  # asphalt, paint, asphalt
BLUR = np.array([0.5, 0.7])
WINDOW = (7, 0.0)
EVEN = np.zeros((2, 2, N_BLOCKS))  # steepness of the ramp
N_HEIGHTS = 7  # of a pixel, over which its area is integrated

_ERF = np.vectorize(math.erf)


def share(columns, rows, edge, slope, sigma):
    """Return the part of each pixel right of an edge that moves ``slope`` columns a row, and is blurred."""
    along = sigma * math.sqrt(1.0 + slope**2)
    total = np.zeros(np.broadcast_shapes(columns.shape, rows.shape))
    for height in (np.arange(N_HEIGHTS) + 0.5) / N_HEIGHTS - 0.5:
        middle = columns - edge - slope * (rows + height - MIDDLE)
        for end, sign in ((0.5, 1.0), (-0.5, -1.0)):
            x = middle + end
            z = x / along
            below = 0.5 * (1.0 + _ERF(z / math.sqrt(2.0)))
            total += sign * (x * below + along * np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi))
    return total / N_HEIGHTS


@cache
def grey_values(greys=GREYS, moved=(0.0, 0.0), blur=tuple(BLUR), wider=0.0, steepness=0.0):
    """Return both images of the model as floats, (H, W).

    Args:
        greys: Asphalt left of the stripes, paint, asphalt right of them.
        moved: By how much left and right edges are right of EDGES [px].
        blur: Of both lenses [px].
        wider: Added to the width of the stripes on either side [px].
        steepness: Of the ramp, relative change of the grey values in RAMP_PX, 1 in the middle of a stripe.
    """
    asphalt_left, paint, asphalt_right = greys
    images = []
    rows, columns = np.arange(HEIGHT)[:, None], np.arange(WIDTH)[None]
    for camera in (0, 1):
        image = np.empty((HEIGHT, WIDTH))
        # Each stripe in its own half.
        for stripe, part in enumerate((slice(None, 110), slice(110, None))):
            (left, right), (slope_left, slope_right) = EDGES[camera, stripe], SLOPES[camera, stripe]
            left, right = left + moved[0] - wider, right + moved[1] + wider
            first = share(columns[:, part], rows, left, slope_left, blur[camera])
            second = share(columns[:, part], rows, right, slope_right, blur[camera])
            grey = asphalt_left + (paint - asphalt_left) * first - (paint - asphalt_right) * second
            middle = (left + right + (slope_left + slope_right) * (rows - MIDDLE)) / 2.0
            image[:, part] = grey * (1.0 + steepness * (columns[:, part] - middle) / RAMP_PX)
        images.append(image)
    return tuple(images)


def rounded(images, noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    return tuple(
        np.clip(np.rint(image + noise * rng.normal(size=image.shape)), 0, 255).astype(np.uint8)
        for image in images
    )


def predicted(wider=0.0):
    """Return the columns (2, L, 2, N, R) of EDGES."""
    edges = EDGES + wider * np.array([-1.0, 1.0])
    return edges[..., None, None] + SLOPES[..., None, None] * (ROWS - MIDDLE)


def measure(images, blur=BLUR, columns=None, steepness=EVEN, window=WINDOW, rows=ROWS, noise=0.0):
    columns = predicted() if columns is None else columns
    return measure_blocks(images, columns, SLOPES, rows, np.array(blur), window, noise, steepness)


# --- displacements -------------------------------------------------------------------------------------


def test_where_the_prediction_is_right_nothing_is_off():
    """But for rounding: of 8 rows and a contrast of 120, 2 mpx; the Monte Carlo below asks for it exactly."""
    blocks = measure(rounded(grey_values()))
    assert blocks.usable.all()
    np.testing.assert_allclose(blocks.displacement[..., :2], 0.0, atol=0.01)
    np.testing.assert_allclose(blocks.displacement[..., 2], 0.0, atol=0.02)


@pytest.mark.parametrize("moved", [(0.1, 0.1), (-0.1, 0.05), (0.0, -0.1)])
def test_displacements_are_those_of_the_edges(moved):
    """Of either edge by itself: of size and sign, to the curvature of the response."""
    blocks = measure(rounded(grey_values(moved=moved)))
    for edge in (0, 1):
        np.testing.assert_allclose(blocks.displacement[..., edge].mean(axis=-1), moved[edge], atol=0.006)


@pytest.mark.parametrize("camera", [0, 1])
def test_the_blur_of_either_lens_is_told(camera):
    changed = BLUR.copy()
    changed[camera] += 0.08
    blocks = measure(rounded(grey_values(blur=tuple(changed))))
    np.testing.assert_allclose(blocks.displacement[camera, ..., 2].mean(axis=-1), 0.08, atol=0.015)
    np.testing.assert_allclose(blocks.displacement[1 - camera, ..., 2].mean(axis=-1), 0.0, atol=0.005)
    np.testing.assert_allclose(blocks.displacement[..., :2].mean(axis=-2), 0.0, atol=0.005)


def test_an_added_blur_is_part_of_the_model():
    """Sqrt(0.3^2 + 0.4^2) is 0.5; the slant of an edge widens the lens's share of it alone."""
    blur = np.sqrt(BLUR**2 - 0.3**2)
    images = rounded(grey_values())
    sharp, added = measure(images, blur), measure(images, blur, window=(7, 0.3))
    assert np.all(sharp.displacement[..., 2].mean(axis=-1) > 0.05)
    assert np.all(np.abs(added.displacement[..., 2].mean(axis=-1)) < 0.03)


def test_gradient_is_information_times_displacement():
    blocks = measure(rounded(grey_values(moved=(0.2, -0.1)), noise=2.0))
    product = np.einsum("...ij,...j->...i", blocks.information, blocks.displacement)
    np.testing.assert_allclose(blocks.gradient, product, rtol=1e-3, atol=1e-6 * np.abs(product).max())


def test_every_block_reads_rows_and_columns_of_its_own():
    """One block of one stripe in one camera is off, and no other."""
    images = [image.copy() for image in grey_values()]
    images[1][ROWS[5], 110:] = grey_values(moved=(0.1, -0.1))[1][ROWS[5], 110:]
    off = measure(rounded(images)).displacement[..., :2]
    np.testing.assert_allclose(off[1, 1, 5], [0.1, -0.1], atol=0.015)
    off[1, 1, 5] = 0.0
    np.testing.assert_allclose(off, 0.0, atol=0.015)


def test_every_other_row_says_half():
    blocks = measure(rounded(grey_values()))
    half = measure(rounded(grey_values()), columns=predicted()[..., ::2], rows=ROWS[:, ::2])
    ratio = half.information[..., :2, :2] / blocks.information[..., :2, :2]
    np.testing.assert_allclose(np.einsum("...ii->...i", ratio), 0.5, rtol=0.05)


# --- what they claim -----------------------------------------------------------------------------------


@pytest.mark.parametrize("wider", [0.0, -3.5])
def test_scatter_is_what_information_and_variance_say(wider):
    """Also of a stripe so narrow that the windows of its edges overlap: a pixel counts once."""
    images = grey_values(wider=wider)
    whitened, variances = [], []
    for seed in range(6):
        blocks = measure(rounded(images, noise=6.0, seed=seed), columns=predicted(wider))
        off, information = blocks.displacement, blocks.information / blocks.variance
        whitened.append(np.einsum("...i,...ij,...j", off, information, off))
        variances.append(blocks.variance)
    # The scatter of the whitened squares of 288 blocks about their three degrees of freedom is 5 %.
    assert np.mean(whitened) == pytest.approx(3.0, rel=0.15)
    assert np.mean(variances) == pytest.approx(36.0, rel=0.08)


def test_seven_numbers_of_a_block_are_no_noise():
    """Three levels, the ramp, two edges and the blur: of the 60 pixels of two rows they take an eighth."""
    columns, rows = predicted()[..., ::4], ROWS[:, ::4]
    images = [rounded(grey_values(), noise=6.0, seed=seed) for seed in range(6)]
    variances = [measure(pair, columns=columns, rows=rows).variance for pair in images]
    assert np.mean(variances) == pytest.approx(36.0 + 1.0 / 12.0, rel=0.05)


def test_in_noise_what_is_known_of_lenses_helps():
    """The ramp is held to what lenses have: the edges are known better, and as well as is said."""
    images, variance = grey_values(), 20.0**2
    whitened, gained = [], []
    for seed in range(6):
        noisy = rounded(images, noise=20.0, seed=seed)
        alone, known = measure(noisy), measure(noisy, noise=variance)
        information = known.information / known.variance
        whitened.append(np.einsum("...i,...ij,...j", known.displacement, information, known.displacement))
        gained.append(np.linalg.slogdet(known.information)[1] - np.linalg.slogdet(alone.information)[1])
        # Of the ramp the noise makes less is believed.
        assert np.mean(known.ramp_sigmas) < 0.8 * np.mean(alone.ramp_sigmas)
    assert np.mean(whitened) == pytest.approx(3.0, rel=0.2)
    assert np.min(gained) >= 0.0 and np.mean(gained) > 0.1


def test_rounding_is_the_least_noise():
    flat = rounded(tuple(np.full((HEIGHT, WIDTH), 100.0) for _ in range(2)))
    assert measure(flat).variance == pytest.approx(1.0 / 12.0)
    assert measure(rounded(grey_values())).variance == pytest.approx(1.0 / 12.0, rel=0.2)


def test_information_goes_by_the_square_of_the_contrast():
    once = measure(rounded(grey_values(greys=(80.0, 120.0, 80.0)))).information
    twice = measure(rounded(grey_values(greys=(80.0, 160.0, 80.0)))).information
    np.testing.assert_allclose(np.einsum("...ii->...i", twice / once), 4.0, rtol=0.06)


# --- which count ---------------------------------------------------------------------------------------


def test_a_gap_of_dashes_is_not_usable():
    images = [image.copy() for image in grey_values()]
    images[0][ROWS[3:5], :110] = 80.0
    usable = measure(rounded(images, noise=1.0)).usable
    assert not usable[0, 0, 3:5].any()
    usable[0, 0, 3:5] = True
    assert usable.all()


@pytest.mark.parametrize(
    "greys", [(200.0, 80.0, 190.0), (200.0, 201.0, 90.0), (90.0, 201.0, 200.0), (60.0, 100.0, 180.0)]
)
def test_paint_is_brighter_than_the_asphalt_on_either_side(greys):
    """Neither a dark stripe nor an edge of one side only is a stripe."""
    assert not measure(rounded(grey_values(greys=greys), noise=2.0)).usable.any()


def test_contrast_has_to_stand_out_of_the_noise():
    """A pixel's noise may be greater than the contrast: a block has a hundred pixels and more a level."""
    images = grey_values(greys=(80.0, 100.0, 80.0))
    assert measure(rounded(images, noise=5.0)).usable.all()
    assert np.mean(measure(rounded(images, noise=60.0)).usable) < 0.1


@pytest.mark.parametrize(("shift", "side"), [(-52.0, 0), (84.0, 1)])
def test_blocks_that_reach_out_of_the_image_are_not_usable(shift, side):
    """The window of its left edge, half 7 px wide, or of its right edge."""
    columns = predicted() + shift
    middles = np.rint(columns[:, :, side])
    inside = (middles >= WINDOW[0]) if side == 0 else (middles < WIDTH - WINDOW[0])
    images = tuple(np.roll(image, int(shift), axis=1) for image in rounded(grey_values()))
    blocks = measure(images, columns=columns)
    complete = inside.all(axis=-1)
    assert complete.any() and not complete.all()
    np.testing.assert_array_equal(blocks.usable & ~complete, False)
    # The other stripe is whole, where the first one's pixels of the other end do not come in by rolling.
    clear = complete & (np.abs(columns[:, :, side].mean(axis=-1) - (0 if side == 0 else WIDTH)) > 20.0)
    assert blocks.usable[clear].all()


def test_nothing_at_all_is_not_usable():
    flat = rounded(tuple(np.full((HEIGHT, WIDTH), 100.0) for _ in range(2)))
    blocks = measure(flat)
    assert not blocks.usable.any()
    assert np.isfinite(blocks.displacement).all() and np.isfinite(blocks.variance)


# --- the ramp ------------------------------------------------------------------------------------------

LENS = -0.02  # of the grey values in 10 px: steeper than is usual, so that it has to be expected


def test_the_ramp_of_a_lens_leaves_the_edges_alone():
    images = rounded(grey_values(steepness=LENS))
    blocks = measure(images, steepness=np.full(EVEN.shape, LENS))
    np.testing.assert_allclose(blocks.displacement[..., :2].mean(axis=-2), 0.0, atol=0.003)
    assert blocks.ramp_sigmas.max() < 0.5


def test_what_the_blocks_say_of_the_ramp_is_its_difference_from_the_expected_one():
    images = rounded(grey_values(steepness=LENS))
    for expected in (0.0, LENS / 2.0):
        ramp = measure(images, steepness=np.full(EVEN.shape, expected)).measure_ramp()
        information, product = ramp[..., 0], ramp[..., 1]
        np.testing.assert_allclose(product / information, LENS - expected, atol=0.003)


def test_information_on_the_ramp_is_its_inverse_variance():
    images, whitened = grey_values(), []
    for seed in range(6):
        blocks = measure(rounded(images, noise=6.0, seed=seed))
        ramp = blocks.measure_ramp()
        whitened.append(ramp[..., 1] ** 2 / ramp[..., 0] / blocks.variance)
    assert np.mean(whitened) == pytest.approx(1.0, rel=0.25)  # of 288 blocks: to 8 %


@pytest.mark.parametrize("steepness", [-0.12, 0.12])
def test_a_ramp_steeper_than_any_lens_is_told(steepness):
    """By so many of 0.015, the expected spread of lenses; its own is less."""
    blocks = measure(rounded(grey_values(steepness=steepness)))
    np.testing.assert_allclose(blocks.ramp_sigmas, 0.12 / 0.015, rtol=0.2)
