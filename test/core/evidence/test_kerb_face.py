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

"""How much lower one edge of a stripe lies: against edges projected from where they are in space."""

import math
from dataclasses import replace

import numpy as np
import pytest
from independent_camera import CAMERAS, image_line
from row_block_making import make_residuals

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.evidence.kerb_face import EdgeStep, measure_edge_steps
from stereo_selfcal.synth.scenes import PAPER_RIG

POSE = Extrinsics(1.4, math.radians(3.0), 0.0)
# Left boundary, right boundary, and a stripe beside the lane.
EDGES_M = np.array([[1.85, 1.70], [-1.65, -1.90], [5.3, 5.2]])
INNER = (1, 0)  # which edge of a boundary is towards the lane
TALL_PIXELS = replace(PAPER_RIG, fy=0.8 * PAPER_RIG.fy)
ROWS = 300.0 + 8.0 * np.arange(20)
VARIANCE = 4.0


def columns_of(edges_m, lower_m, rig):
    """Return the columns (2, L, 2, N) of edges at (L, 2) [m], lower than the road by (L, 2) [m].

    A line h below the road is a line on a road that the camera is h higher over.
    """
    columns = np.empty((2, *lower_m.shape, len(ROWS)))
    for i, stripe, edge in np.ndindex(2, *lower_m.shape):
        pose = Extrinsics(POSE.height_m + lower_m[stripe, edge], POSE.pitch_rad, POSE.roll_rad)
        slope, at_0 = image_line(rig, pose, CAMERAS[i], edges_m[stripe, edge])
        columns[i, stripe, edge] = at_0 + slope * ROWS
    return columns


class Lane:
    """A lane whose boundaries are lower at the edge towards it, as a fit of level stripes has it.

    Level stripes fit best where an edge is farther towards the middle, in the proportion of the heights: what
    they do not explain is that the cameras, half a baseline to either side, do not see it alike.
    """

    def __init__(self, left_m=0.0, right_m=0.0, rig=PAPER_RIG):
        self.rig = rig
        lower_m = np.zeros((3, 2))
        lower_m[0, INNER[0]], lower_m[1, INNER[1]] = left_m, right_m
        fitted_m = EDGES_M / (1.0 + lower_m / POSE.height_m)
        self.columns = columns_of(fitted_m, np.zeros((3, 2)), rig)
        self.widths_m = fitted_m[:, 0] - fitted_m[:, 1]
        self.off = np.moveaxis(columns_of(EDGES_M, lower_m, rig) - self.columns, 2, -1)  # (2, L, N, 2)

    def measure(self, off=None, **known):
        known.setdefault("variance", VARIANCE)
        edges = make_residuals(self.off if off is None else off, self.columns, ROWS, **known)
        return measure_edge_steps(edges, self.widths_m, self.rig)

    def px_per_m(self, stripe):
        return (self.columns[:, stripe, 1] - self.columns[:, stripe, 0]) / self.widths_m[stripe]


def assert_unseen(step):
    assert math.isnan(step.height_m) and math.isnan(step.std_m)
    assert not step.surely_lower_than(1e9)


# What a pixel sees of a height h is h H / (H + h); 2 % less for 3 cm under 1.4 m.
@pytest.mark.parametrize("rig", [PAPER_RIG, TALL_PIXELS], ids=["square", "tall"])
@pytest.mark.parametrize(("left_m", "right_m"), [(0.0, 0.0), (0.02, 0.0), (0.0, 0.02), (-0.01, 0.015)])
def test_height_is_how_much_lower_the_edge_towards_the_lane_lies(left_m, right_m, rig):
    left, right = Lane(left_m, right_m, rig).measure()
    assert left.height_m == pytest.approx(left_m / (1.0 + left_m / POSE.height_m), abs=3e-4)
    assert right.height_m == pytest.approx(right_m / (1.0 + right_m / POSE.height_m), abs=3e-4)


def test_a_stripe_that_is_wider_than_the_fit_has_it_is_level():
    """Paint wider by 4 mm towards the lane, on the road: both cameras see it alike."""
    lane = Lane()
    off = np.zeros(lane.off.shape)
    off[:, 0, :, 1] += 0.004 * lane.px_per_m(0)
    off[:, 1, :, 0] -= 0.004 * lane.px_per_m(1)
    for step in lane.measure(off):
        assert step.height_m == pytest.approx(0.0, abs=1e-9)


def test_the_standard_deviation_is_that_of_the_edges():
    """Of unlike weights: sums of inverse variances of either edge, a tenth of a pixel of paint included."""
    lane, rng = Lane(), np.random.default_rng(0)
    information = rng.uniform(40.0, 150.0, lane.off.shape)
    std_px = np.sqrt(VARIANCE / information + 0.1**2)
    for stripe, step in enumerate(lane.measure(information=information)):
        variances = 1.0 / np.sum(lane.px_per_m(stripe) ** 2 / (std_px[:, stripe] ** 2).sum(axis=-1), axis=-1)
        inner = lane.columns[:, stripe, INNER[stripe]]
        slopes = (inner[:, -1] - inner[:, 0]) / (ROWS[-1] - ROWS[0])
        expected = math.sqrt(variances.sum()) / abs(slopes[0] - slopes[1])
        assert step.std_m == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_errors_scatter_by_the_standard_deviation(scale):
    """Also where blocks scatter more than they say."""
    lane, rng = Lane(), np.random.default_rng(1)
    std_px = scale * math.sqrt(VARIANCE / 200.0 + 0.1**2)
    steps = [lane.measure(std_px * rng.normal(size=lane.off.shape), information=200.0) for _ in range(200)]
    for which in (0, 1):
        off = [pair[which].height_m / pair[which].std_m for pair in steps]
        # Of 200: to 5 %. The blocks of 1 px and more off are left out, and the biweight of 20 claims less.
        assert np.std(off) == pytest.approx(1.0, abs=0.25)
        assert abs(np.mean(off)) < 0.3


def test_blocks_that_are_wrong_are_left_out():
    lane = Lane(0.02, 0.02)
    wrong = lane.off.copy()
    wrong[0, :, 2::5, 0] -= 0.6
    for step, clean in zip(lane.measure(wrong, information=1e4), lane.measure(information=1e4), strict=True):
        assert step.height_m == pytest.approx(clean.height_m, abs=0.3 * clean.std_m)


# --- which blocks count --------------------------------------------------------------------------------

N = len(ROWS)


def measure_without(mask, kind):
    """Measure a lane of which blocks (N,) are of no use."""
    lane = Lane(0.02, 0.02)
    off, shape = lane.off.copy(), lane.off.shape[:-1]
    # Where they are used they change everything.
    off[:, :, mask, 1] += (1.5 if kind == "far" else 0.5) * np.array([1.0, -1.0])[:, None, None]
    known = {}
    if kind == "unusable":
        known["usable"] = np.broadcast_to(~mask, shape)
    elif kind == "ramp":
        known["ramp_sigmas"] = np.broadcast_to(np.where(mask, 3.1, 2.9), shape)
    elif kind == "faint edge":
        information = np.full(off.shape, 1e5)
        information[..., 0][..., mask] *= 0.24
        information[..., 0][..., ~mask] *= 0.26
        known["information"] = information
    return lane.measure(off, **known)


@pytest.mark.parametrize("kind", ["unusable", "ramp", "faint edge", "far"])
def test_blocks_that_are_no_stripe_have_no_say(kind):
    """Not even where they are most: no robust weight could leave them out.

    Less than half the contrast is less than a quarter of the information.
    """
    for step in measure_without(np.arange(N) >= 4, kind):
        assert step.height_m == pytest.approx(0.02, abs=1e-3)
    for step in measure_without(np.arange(N) >= 3, kind):
        assert_unseen(step)


def test_four_blocks_are_needed_of_either_camera():
    usable = np.ones((2, 3, N), bool)
    usable[1, 0, 3:] = False
    left, right = Lane(0.02, 0.02).measure(usable=usable)
    assert_unseen(left)
    assert right.height_m == pytest.approx(0.02, abs=1e-3)


def test_a_line_that_both_cameras_see_alike_shows_no_height():
    lane = Lane()
    lane.columns[1] = lane.columns[0]
    for step in lane.measure():
        assert_unseen(step)


@pytest.mark.parametrize(
    ("height_m", "std_m", "excluded"),
    [(0.0, 0.01, True), (0.0, 0.031, False), (0.05, 0.0, True), (0.061, 0.0, False), (-0.05, 0.006, False)],
)
def test_a_face_is_excluded_by_two_standard_deviations(height_m, std_m, excluded):
    """Of either sign: an edge that stands higher is no level stripe either."""
    assert EdgeStep(height_m, std_m).surely_lower_than(0.06) == excluded
