"""The asphalt as a witness: agreement, no texture, and lines that lie in another plane."""

import math
from dataclasses import replace

import numpy as np

from stereo_selfcal import Calibrator, CalibratorConfig, RejectReason
from stereo_selfcal.core import calibrator as calibrator_module
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import random_scene

WITNESS = CalibratorConfig.from_mapping({"texture.check": 1})


def coarse_asphalt(texture_amplitude):
    """Return a scene and its frame without noise: what the texture says is clear, or there is none."""
    scene = random_scene(np.random.default_rng(3), texture_amplitude=texture_amplitude)
    return scene, render(scene, np.random.default_rng(0))


def test_the_asphalt_agrees_and_is_a_stage():
    scene, images = coarse_asphalt(12.0)
    result = Calibrator(scene.rig, WITNESS).add(*images)
    assert result.accepted
    assert list(result.stages)[-1] == "textured"
    assert not any("asphalt" in note for note in result.notes)
    difference = result.stages["textured"].as_array() - scene.extrinsics.as_array()
    assert np.all(np.abs(difference) < [0.030, math.radians(0.25), math.radians(0.8)])


def test_without_texture_the_lines_stand_alone_and_say_so():
    scene, images = coarse_asphalt(0.0)
    result = Calibrator(scene.rig, WITNESS).add(*images)
    assert result.accepted
    assert "textured" not in result.stages
    assert "not checked against the asphalt" in result.message


def test_lines_on_another_plane_than_the_asphalt_are_refused(monkeypatch):
    """The estimate from lines is moved by 60 mm, as a kerb would: the images say otherwise."""
    scene, images = coarse_asphalt(12.0)
    refine = calibrator_module.refine

    def kerb(*arguments):
        fit = refine(*arguments)
        return replace(fit, extrinsics=replace(fit.extrinsics, height_m=fit.extrinsics.height_m + 0.06))

    monkeypatch.setattr(calibrator_module, "refine", kerb)
    assert Calibrator(scene.rig).add(*images).accepted
    result = Calibrator(scene.rig, WITNESS).add(*images)
    assert result.reason is RejectReason.TEXTURE_DISAGREES
    assert result.extrinsics is None
    assert {"genetic", "refined", "textured"} <= set(result.stages)
    assert "asphalt" in result.message
