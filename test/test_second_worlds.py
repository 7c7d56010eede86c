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

"""The second generator's pictures show what its truth says: checked by projections that are written here."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.options import Options
from benchmarks.second import Judged, by_kind, faults, judge_world, summary, write_case
from benchmarks.second_worlds import draw, kinds
from benchmarks.second_worlds.cameras import Mount, Turn, camera_pair, pose_over_plane
from benchmarks.second_worlds.drafts import SIDES, Draft, everyday_sensor, ground, ordinary
from benchmarks.second_worlds.objects import solid
from benchmarks.second_worlds.raster import planes_before, rasterise
from benchmarks.second_worlds.roads import Alignment
from benchmarks.second_worlds.scenes import Scene
from benchmarks.second_worlds.shading import picture
from stereo_selfcal import StereoRig

RIG = StereoRig(640, 480, 516.6, 520.0, 310.2, 236.7, 0.1481)
MOUNT = Mount(1.42, math.radians(4.1), math.radians(-1.7), math.radians(2.2), 0.3)
STRONG = 1.2


def _draft(*, lines: bool = False, seed: int = 3) -> Draft:
    """Return a flat road without anything beside it, seen by RIG at MOUNT."""
    draft = ordinary(np.random.default_rng(seed), STRONG)
    draft.rig, draft.mount = RIG, MOUNT
    draft.others, draft.seams = [], []
    draft.edges_m = {"left": 60.0, "right": 60.0}
    draft.sensor = everyday_sensor(draft)
    if not lines:
        draft.lines = {}
    return draft


def _pair(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return the light of both images, without a sensor."""
    still = np.zeros(scene.rig.height)
    cameras = camera_pair(scene.rig, scene.mount, scene.turn, still, still)
    plane, _ = scene.road.plane()
    left, right = (picture(scene, camera, plane)[0] for camera in cameras)
    return left, right


def _disparity(pose: tuple[float, float, float], col: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Return the disparity of the road at pixels of the left image, from height, pitch and roll alone."""
    height, pitch, roll = pose
    # Up, in the axes of the camera's body (x forward, y left, z up): the last row of R_y(pitch) R_x(roll).
    up = np.array([-math.sin(pitch), math.cos(pitch) * math.sin(roll), math.cos(pitch) * math.cos(roll)])
    # p = depth (1, -(col - cx) / fx, -(row - cy) / fy) + (0, baseline / 2, 0), and up . p = -height.
    slope = up[0] - up[1] * (col - RIG.cx) / RIG.fx - up[2] * (row - RIG.cy) / RIG.fy
    depth = -(height + up[1] * RIG.baseline_m / 2) / slope
    return RIG.fx * RIG.baseline_m / depth


def _bicubic(image: np.ndarray, col: np.ndarray, row: np.ndarray) -> np.ndarray:
    return cv2.remap(image, col.astype(np.float32), row.astype(np.float32), cv2.INTER_CUBIC)


def _offsets(left: np.ndarray, right: np.ndarray, disparity: np.ndarray, first_row: int) -> np.ndarray:
    """Return by how much patches of the right image lie further left than expected [px], by least squares."""
    row, col = np.mgrid[first_row : RIG.height, 0 : RIG.width]
    expected = _bicubic(right, col - disparity, row)
    ahead = _bicubic(right, col - disparity + 0.5, row)
    behind = _bicubic(right, col - disparity - 0.5, row)
    gradient, difference = ahead - behind, left[first_row:] - expected
    offsets = []
    for top in range(8, gradient.shape[0] - 50, 50):
        for side in range(100, RIG.width - 160, 60):
            patch = slice(top, top + 50), slice(side, side + 60)
            g, d = gradient[patch].ravel(), difference[patch].ravel()
            offsets.append(-(g @ d) / (g @ g))
    return np.array(offsets)


@pytest.mark.parametrize("crown", [0.0, 0.02])
def test_texture_of_a_plane_has_the_disparities_of_its_pose(crown: float) -> None:
    draft = _draft()
    draft.crown = [(-60.0, -60.0 * crown), (60.0, 60.0 * crown)]
    scene = draft.scene()
    pose = pose_over_plane(scene.mount, scene.road.plane()[0])
    first = 260
    row, col = np.mgrid[first : RIG.height, 0 : RIG.width]
    offsets = _offsets(*_pair(scene), _disparity(pose, col, row), first)
    assert len(offsets) >= 20
    assert abs(offsets.mean()) < 0.01
    assert np.abs(offsets).max() < 0.05


def test_a_wrong_pose_is_seen_by_that_measure() -> None:
    scene = _draft().scene()
    height, pitch, roll = pose_over_plane(scene.mount, scene.road.plane()[0])
    row, col = np.mgrid[260 : RIG.height, 0 : RIG.width]
    offsets = _offsets(*_pair(scene), _disparity((height + 0.01, pitch, roll), col, row), 260)
    assert abs(offsets.mean()) > 0.05


def test_lines_lie_where_the_road_has_them() -> None:
    draft = _draft(lines=True)
    draft.surface = replace(draft.surface, grain=0.0, cloud=0.0, blotch=0.0, tracks=0.0)
    draft.light = replace(draft.light, haze_m=1e9)
    scene = draft.scene()
    still = np.zeros(RIG.height)
    for camera in camera_pair(RIG, MOUNT, Turn(), still, still):
        light, _ = picture(scene, camera, (0.0, 0.0, 0.0))
        for side in SIDES:
            line = draft.lines[side][0]
            x = np.linspace(2.5, 14, 4000)
            edges = [line.t_m - line.width_m / 2, line.t_m + line.width_m / 2]
            seen = [
                camera.project(np.stack([x, np.full_like(x, t), np.zeros_like(x)], axis=1)) for t in edges
            ]
            for row in range(290, 400, 10):
                left, right = sorted(float(np.interp(row, each[::-1, 1], each[::-1, 0])) for each in seen)
                begin = int(left) - 8
                if begin < 0 or right + 10 > RIG.width:
                    continue
                part = light[row, begin : int(right) + 10]
                above = part - part[0]
                assert above.sum() / above.max() == pytest.approx(right - left, abs=0.03)
                centre = begin + (above * np.arange(len(above))).sum() / above.sum()
                assert centre == pytest.approx((left + right) / 2, abs=0.02)


def _nearest(corners: np.ndarray, origin: np.ndarray, ray: np.ndarray) -> tuple[float, int]:
    """Return how far along a ray the first polygon is, and which: by the areas of triangles."""
    best, which = math.inf, -1
    for first, second, third in ((0, 1, 2), (0, 2, 3)):
        a, b, c = corners[:, first], corners[:, second], corners[:, third]
        ab, ac = b - a, c - a
        p = np.cross(ray, ac)
        det = np.einsum("ij,ij->i", ab, p)
        with np.errstate(divide="ignore", invalid="ignore"):
            q = np.cross(origin - a, ab)
            u = np.einsum("ij,ij->i", origin - a, p) / det
            v = q @ ray / det
            t = np.einsum("ij,ij->i", ac, q) / det
            hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0.3) & (np.abs(det) > 1e-12)
        if hit.any():
            index = int(np.flatnonzero(hit)[np.argmin(t[hit])])
            if t[index] < best:
                best, which = float(t[index]), index
    return best, which


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["kerb_for_line", "rail_for_line", "slope_ahead", "curve", "crown"])
def test_each_ray_sees_the_nearest_surface(kind: str) -> None:
    world = draw(11, 4, kind=kind)
    scene = world.scene
    still = np.zeros(scene.rig.height)
    mesh = scene.mesh
    rng = np.random.default_rng(0)
    for camera in camera_pair(scene.rig, scene.mount, scene.turn, still, still):
        planes = planes_before(mesh, camera)
        samples = rasterise(mesh, camera, planes)
        total = np.bincount(samples.pixel, samples.weight, minlength=scene.rig.width * scene.rig.height)
        np.testing.assert_allclose(total, 1.0, atol=1e-5)
        whole = np.flatnonzero(samples.weight == 1)
        differing = 0
        chosen = rng.choice(whole, 400, replace=False)
        for each in chosen:
            directions = camera.directions(samples.col[each : each + 1], samples.row[each : each + 1])
            ray = np.array([float(part[0]) for part in directions])
            distance, index = _nearest(mesh.corners_m, camera.centre_m, ray)
            mine = samples.polygon[each]
            if mine != index:
                same = mine >= 0 and index >= 0 and mesh.group[mine] == mesh.group[index]
                differing += not same
            if mine >= 0:
                depth = 1 / (planes.inverse_depth[mine] @ [samples.col[each], samples.row[each], 1.0])
                assert depth == pytest.approx(distance, rel=2e-3) or mine != index
        assert differing <= 1  # a ray along a border


def test_a_kerb_and_its_pavement_stand_above_the_plane_of_the_truth() -> None:
    """What lies behind a kerb has the disparities of a plane that is higher by the kerb's face."""
    draft = _draft()
    face = 0.12
    pavement = ground(0.3, 0.3, 0.004)
    draft.edges_m["right"] = 1.6
    draft.sides["right"] = [(0.0, face, solid(0.2)), (20.0, 0.0, pavement)]
    draft.scenery = dict.fromkeys(SIDES, False)
    scene = draft.scene()
    height, pitch, roll = pose_over_plane(scene.mount, scene.road.plane()[0])
    row, col = np.mgrid[300 : RIG.height, 0 : RIG.width]
    left, right = _pair(scene)
    part = slice(0, 50), slice(540, 630)  # of the rows from 300 on: all pavement
    offsets = []
    for above in (0.0, face):
        disparity = _disparity((height - above, pitch, roll), col, row)
        expected = _bicubic(right, col - disparity, row)[part]
        slope = np.gradient(cv2.GaussianBlur(right, (0, 0), 1.0), axis=1)
        gradient = _bicubic(slope, col - disparity, row)[part].ravel()
        offsets.append(-(gradient @ (left[300:][part] - expected).ravel()) / (gradient @ gradient))
    assert abs(offsets[1]) < 0.02
    assert abs(offsets[0]) > 0.2


@pytest.mark.slow
def test_same_seed_same_bytes() -> None:
    first, second = draw(2, 7), draw(2, 7)
    for one, two in zip(first.render(), second.render(), strict=True):
        assert one.tobytes() == two.tobytes()
    left, right = first.render()
    assert left.dtype == right.dtype == np.uint8
    assert left.shape == right.shape == (first.rig.height, first.rig.width)


def test_truth_has_the_signs_of_the_contract() -> None:
    flat = (0.0, 0.0, 0.0)
    assert pose_over_plane(MOUNT, flat) == pytest.approx((MOUNT.height_m, MOUNT.pitch_rad, MOUNT.roll_rad))
    straight = Mount(1.5, 0.0, 0.0, 0.0, 0.0)
    # A road that rises ahead: the nose is down against it. One that rises to the left: the right side is up.
    assert pose_over_plane(straight, (0.0, 0.02, 0.0))[1] == pytest.approx(math.atan(0.02))
    assert pose_over_plane(straight, (0.0, 0.0, 0.02))[2] == pytest.approx(-math.atan(0.02))
    assert pose_over_plane(straight, (0.1, 0.0, 0.0))[0] == pytest.approx(1.4)


def test_a_bend_of_the_slope_is_measured() -> None:
    edges = ((-4.0, 0.0), (4.0, 0.0))
    plane, leave = Alignment(0.0, ((9.0, 0.03),), 3.5, edges).plane()
    assert 0 < plane[1] < 0.03
    assert 0.01 < leave < 0.1
    assert Alignment(0.0, ((16.0, 0.03),), 3.5, edges).plane()[1] == pytest.approx(0.0, abs=1e-12)


def test_arc_and_lane_are_inverse() -> None:
    road = Alignment(-0.004, (), 3.5, ((-4.0, 0.0), (4.0, 0.0)))
    s, t = np.meshgrid(np.linspace(-2, 60, 9), np.linspace(-3, 3, 5))
    points = road.world(s, t, np.zeros_like(s)).astype(np.float32)
    back = road.lane(points[..., 0], points[..., 1])
    np.testing.assert_allclose(back[0], s, atol=1e-3)
    np.testing.assert_allclose(back[1], t, atol=1e-3)


@pytest.mark.parametrize(
    ("turn", "axis", "expected"),
    [
        (Turn(yaw_rad=0.002), 0, RIG.fx * 0.002),
        (Turn(pitch_rad=0.002), 1, -RIG.fy * 0.002),
        (Turn(row_px=0.25), 1, 0.25),
    ],
)
def test_a_turned_camera_moves_its_content(turn: Turn, axis: int, expected: float) -> None:
    still = np.zeros(RIG.height)
    straight, turned = (camera_pair(RIG, MOUNT, each, still, still)[1] for each in (Turn(), turn))
    point = np.array([30.0, 0.3, 0.0])
    moved = turned.project(point) - straight.project(point) - [0, turned.row_shift_px[0], 0]
    assert moved[axis] == pytest.approx(expected, rel=0.03)


def test_a_row_offset_is_in_the_picture() -> None:
    draft = _draft()
    straight = cv2.GaussianBlur(_pair(draft.scene())[1], (0, 0), 2.0)
    draft.builder = type(draft.builder)()
    draft.turn = Turn(row_px=0.25)
    moved = cv2.GaussianBlur(_pair(draft.scene())[1], (0, 0), 2.0)
    part = slice(300, 460), slice(50, 590)
    gradient = np.gradient(straight, axis=0)[part].ravel()
    shift = -(gradient @ (moved - straight)[part].ravel()) / (gradient @ gradient)
    assert shift == pytest.approx(0.25, abs=0.03)


def test_every_kind_can_be_drawn() -> None:
    names = [kind.name for kind in kinds(turned=True)]
    assert len(set(names)) == len(names)
    for number, name in enumerate(names):
        world = draw(21, number, kind=name)
        assert world.kind == name
        assert 0.3 < world.truth.height_m < 3.3
        assert ("turned" in world.tags) == (world.scene.turn != Turn())


@pytest.mark.slow
def test_about_half_of_the_worlds_are_good_and_none_is_turned() -> None:
    worlds = [draw(1, index) for index in range(150)]
    assert 0.35 < np.mean([world.good for world in worlds]) < 0.8
    assert all(world.scene.turn == Turn() for world in worlds)
    assert any("low_rig" in world.tags for world in worlds)


@pytest.mark.slow
def test_a_world_is_judged_and_written(tmp_path: Path) -> None:
    judged = judge_world(1, False, None, 0)
    world = draw(1, 0)
    assert (judged.kind, judged.good) == (world.kind, world.good)
    assert judged.accepted == (judged.error_mm is not None)
    assert judged.accepted != bool(judged.reason)
    case = write_case(world, tmp_path)
    assert sorted(path.name for path in case.iterdir()) == ["case.json", "left.png", "right.png"]
    numbers = json.loads((case / "case.json").read_text())
    assert numbers["truth"]["height_m"] == world.truth.height_m
    assert StereoRig.from_mapping(numbers["rig"]) == world.rig


def test_wrong_and_gross_results_are_counted() -> None:
    right = Judged(
        *(0, "plain", "kitti", "", True, True, ""),
        *(1.0, 0.1, 0.1, 2.0, 0.2, 0.2, 1.5, 0.0, 0.0, 90, 90),
        *(False, False, 0.1),
    )
    wrong = replace(right, index=1, wrong=True, gross=True, good=False, error_mm=100.0)
    refused = replace(right, index=2, accepted=False, tags="low_rig", reason="x", error_mm=None, std_mm=None)
    answers = [right, wrong, refused]
    row = summary(answers, Options()).rows[0]
    assert row[-1] == "0.5 / 0.5 / 0.5"
    assert row[:7] == ("3", "2", "1", "1", "2", "1 of 1 (100.0%)", "0 of 1 (0.0%)")
    assert [cells[0] for cells in faults(answers).rows] == ["1"]
    assert by_kind(answers).rows[0][-1] == "x 1"
