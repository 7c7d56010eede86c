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

"""What is unknown besides the pose: its covariances against draws of it, and what it may not change."""

import numpy as np
import pytest
from independent_camera import ideal_pattern

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.evidence.nuisances import paint_angle_covariance
from stereo_selfcal.core.geometry.homography import apply_homography, road_from_image
from stereo_selfcal.core.geometry.plane import plane_from_pose
from stereo_selfcal.synth.scenes import PAPER_RIG

POSE = Extrinsics(1.4, 0.05, 0.02)
PATTERN = ideal_pattern(PAPER_RIG, POSE)


def angle_between_lines(pose):
    """Return the angle between both lines of the pattern on the road of a pose (3,)."""
    to_road = road_from_image(PAPER_RIG, Extrinsics.from_array(pose), "left")
    directions = []
    for line in PATTERN.left:
        rows = np.array([line.rows.min(), line.rows.max()])
        far, near = apply_homography(to_road, np.column_stack([line.column_at(rows), rows]))
        directions.append(np.arctan2(far[1] - near[1], far[0] - near[0]))
    return directions[0] - directions[1]


def test_lines_that_are_not_parallel_move_the_pose_where_their_disparities_change_least():
    """Of all poses under which the lines meet at that angle, this one fits what both cameras see best."""
    pose = POSE.as_array()
    columns = PATTERN.columns.mean(axis=0)  # of a camera in the middle
    rays = np.stack(
        [
            np.ones_like(columns),
            -(columns - PAPER_RIG.cx) / PAPER_RIG.fx,
            -(np.broadcast_to(PATTERN.rows, columns.shape) - PAPER_RIG.cy) / PAPER_RIG.fy,
        ],
        axis=-1,
    )

    def disparities(change):
        return plane_from_pose(Extrinsics.from_array(pose + change), PAPER_RIG).disparities(rays)

    def misfit(change):
        return np.sum((disparities(change) - disparities(np.zeros(3))) ** 2)

    covariance = paint_angle_covariance(PATTERN, PAPER_RIG, POSE)
    along = np.sqrt(np.diag(covariance)) * np.sign(covariance[1]) / 10.0  # where all is linear
    by_pose = np.array([angle_between_lines(pose + step) for step in 1e-6 * np.eye(3)])
    by_pose = (by_pose - angle_between_lines(pose)) / 1e-6
    assert abs(by_pose @ along) == pytest.approx(0.0005, rel=0.01)
    rng = np.random.default_rng(0)
    for _ in range(30):
        aside = rng.normal(size=3) * np.abs(along)
        aside -= by_pose * (by_pose @ aside) / (by_pose @ by_pose)
        assert misfit(along + aside) > misfit(along)
