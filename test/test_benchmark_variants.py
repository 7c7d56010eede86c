"""The variants of recorded frames show the road they say: made of a rendered frame, whose pose is known."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.frames import READABLE
from benchmarks.recorded import Recorded
from benchmarks.variants import VARIANTS, Judged, mirrored
from stereo_selfcal import calibrate
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import random_scene

RIGHT = np.array([5.0, 0.05, 0.15])  # mm, deg, deg: a variant that is off by a pixel is off by more


@pytest.fixture(scope="module")
def frame():
    scene = random_scene(np.random.default_rng(3), 0.005)
    scene = replace(scene, rig=replace(scene.rig, width=1242, cx=620.5))  # wide enough to be cut
    left, right = render(scene, np.random.default_rng(4))
    return Recorded("3", "rendered", scene.rig, left, right, scene.extrinsics.as_array() * READABLE)


@pytest.mark.parametrize("name", VARIANTS)
def test_variant_has_the_pose_it_says(frame, name):
    variant = VARIANTS[name](frame)
    assert variant.left.shape == variant.right.shape == (variant.rig.height, variant.rig.width)
    assert variant.left.dtype == np.uint8
    result = calibrate(variant.left, variant.right, variant.rig)
    assert result.accepted, result.message
    assert np.all(np.abs(result.extrinsics.as_array() * READABLE - variant.reference) < RIGHT)


def test_mirrored_twice_is_the_frame(frame):
    again = mirrored(mirrored(frame))
    assert again.rig == frame.rig
    np.testing.assert_array_equal(again.left, frame.left)
    np.testing.assert_array_equal(again.reference, frame.reference)


def test_variants_are_the_same_every_time(frame):
    for make in VARIANTS.values():
        np.testing.assert_array_equal(make(frame).right, make(frame).right)


def test_wrong_is_accepted_and_far_off():
    far, near = np.array([61.0, 0.0, 0.0]), np.array([59.0, 0.49, 1.19])
    std = np.ones(3)
    assert Judged("as it is", "1", "any", "", far, std).wrong
    assert not Judged("as it is", "1", "any", "", near, std).wrong
    assert not Judged("as it is", "1", "any", "no_lines_found", np.empty(0), np.empty(0)).wrong
