import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.drive.way_by_patches import PatchStep, road_step
from stereo_selfcal.core.estimators.road_patch import RoadPatch, road_patch
from stereo_selfcal.core.rejection import NotFitted
from stereo_selfcal.synth.scenes import custom_scene


def drive(speed_mps, texture=16.0, n=4, **scene):
    made = custom_scene(lane_yaw_rad=0.01, seed=4, **scene)
    road = replace(made.scene.road, texture_amplitude=texture)
    made = replace(made, speed_mps=speed_mps, scene=replace(made.scene, road=road))
    frames = [made.frame(i) for i in range(n)]
    return [(each.stamp_s, road_patch(each.left, made.scene.rig, made.scene.extrinsics)) for each in frames]


@pytest.mark.slow
@pytest.mark.parametrize("speed_mps", [2.0, 8.0, 15.0])
def test_the_speed_over_a_road_with_texture_and_lines(speed_mps):
    patches = drive(speed_mps)
    for before, after in pairwise(patches):
        step = road_step(before, after)
        assert isinstance(step, PatchStep), step.reason
        assert abs(step.way_m - 0.1 * speed_mps) < 3.0 * step.std_m
        assert step.way_m == pytest.approx(0.1 * speed_mps, abs=0.08)
        assert step.speed_mps == pytest.approx(10.0 * step.way_m)
        assert step.middle_s == pytest.approx(before[0] + 0.05)


def test_a_road_without_texture_tells_no_way():
    patches = drive(8.0, texture=0.0, n=2)
    assert isinstance(road_step(*patches), NotFitted)


def test_views_of_different_roads_tell_no_way():
    rng = np.random.default_rng(1)
    patches = [(float(i), RoadPatch(rng.integers(0, 255, (200, 48), dtype=np.uint8), 3.0)) for i in range(2)]
    assert isinstance(road_step(*patches), NotFitted)


def test_a_pattern_that_repeats_itself_tells_no_way():
    rng = np.random.default_rng(1)
    repeated = np.tile(rng.integers(0, 255, (20, 48), dtype=np.uint8), (10, 1))
    patches = [(float(i), RoadPatch(repeated, 3.0)) for i in range(2)]
    found = road_step(*patches)
    assert isinstance(found, NotFitted)
    assert "another way" in found.reason


def test_frames_in_the_wrong_order_and_a_black_view():
    black = RoadPatch(np.zeros((200, 48), np.uint8), 3.0)
    assert isinstance(road_step((1.0, black), (1.0, black)), NotFitted)
    assert isinstance(road_step((1.0, black), (2.0, black)), NotFitted)


def test_a_camera_that_looks_up_shows_no_road():
    scene = custom_scene().scene
    image = np.zeros((scene.rig.height, scene.rig.width), np.uint8)
    assert road_patch(image, scene.rig, Extrinsics(1.4, math.radians(-40.0), 0.0)) is None
