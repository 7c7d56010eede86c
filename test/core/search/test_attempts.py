"""What a frame went through: each hypothesis that was solved is in the result, with verdict and reason."""

from dataclasses import replace

import numpy as np
import pytest

from stereo_selfcal import Calibrator, CalibratorConfig, RejectReason
from stereo_selfcal.core.evidence.frame_evidence import FoundBy, FrameObservations, Hypothesis
from stereo_selfcal.core.search import solve
from stereo_selfcal.core.search.attempt import Attempt, Verdict
from stereo_selfcal.core.search.strategy import choose
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import random_scene

LINES_ALONE = CalibratorConfig.from_mapping({"texture.check": 0})


@pytest.fixture(scope="module")
def textured():
    scene = random_scene(np.random.default_rng(3), texture_amplitude=12.0)
    return scene, render(scene, np.random.default_rng(0))


def raise_lines(monkeypatch, height_m):
    """Move every estimate from stripes up, as kerbs would: a gate refuses them all."""
    refine = solve.refine

    def kerb(*arguments):
        fit = refine(*arguments)
        return replace(fit, extrinsics=replace(fit.extrinsics, height_m=fit.extrinsics.height_m + height_m))

    monkeypatch.setattr(solve, "refine", kerb)


def test_the_clearest_pair_that_is_accepted_is_the_only_attempt(textured):
    scene, images = textured
    result = Calibrator(scene.rig).add(*images)
    (attempt,) = result.attempts
    assert attempt.accepted and attempt.verdict is Verdict.ACCEPTED and attempt.found_by is FoundBy.HOUGH
    assert attempt.stages == result.stages and attempt.readings == result.gates
    assert attempt.estimate.pose == result.extrinsics
    assert attempt.message == "" and attempt.reason is None


def test_what_was_refused_before_is_told_with_pattern_readings_and_reason(textured, monkeypatch):
    scene, images = textured
    raise_lines(monkeypatch, 0.07)
    result = Calibrator(scene.rig).add(*images)
    assert result.accepted
    *before, last = result.attempts
    assert before and last.accepted and last.found_by is FoundBy.SURFACE and last.pattern is None
    assert list(last.stages) == ["textured"]
    for attempt in before:
        assert attempt.verdict is Verdict.REFUSED
        assert attempt.reason is RejectReason.STAGES_DISAGREE
        assert attempt.message == attempt.rejection.message
        assert attempt.pattern is not None and "refined" in attempt.stages
        assert not attempt.readings[-1].passed and all(each.passed for each in attempt.readings[:-1])


def test_an_estimator_that_gives_up_says_why_and_does_not_decide(textured, monkeypatch):
    """The refusal is that of the lines, which had more to go by."""
    scene, images = textured
    raise_lines(monkeypatch, 0.07)
    monkeypatch.setattr(solve, "line_on_road", lambda *_: None)
    result = Calibrator(scene.rig).add(*images)
    assert result.reason is RejectReason.STAGES_DISAGREE
    assert result.pattern is not None and result.gates
    last = result.attempts[-1]
    assert last.verdict is Verdict.NOT_FITTED and last.rejection is None and last.estimate is None
    assert last.message == "0 lines that both cameras see lie in the road surface, at least 1 needed"


def test_lines_that_the_texture_has_to_confirm_do_not_count_without_it():
    scene = random_scene(np.random.default_rng(3), texture_amplitude=0.0)
    images = render(scene, np.random.default_rng(0))
    first = Calibrator(scene.rig).add(*images)
    assert first.accepted and not first.confirmed_by_texture
    needing = replace(first.attempts[0].hypothesis, needs_texture=True)
    frame = FrameObservations.from_images(images, CalibratorConfig())
    attempt = solve.solve(needing, frame, scene.rig, CalibratorConfig())
    assert attempt.verdict is Verdict.UNCONFIRMED and not attempt.accepted
    assert "need the texture; not checked against the texture of the road surface" in attempt.message
    assert attempt.estimate is not None
    assert choose([attempt]) is None


def test_a_hypothesis_needs_lines_or_the_surface(textured):
    scene, images = textured
    frame = FrameObservations.from_images(images, CalibratorConfig())
    with pytest.raises(ValueError, match="pair of lines or the texture"):
        solve.solve(Hypothesis(FoundBy.SURFACE, None), frame, scene.rig, CalibratorConfig())


def attempt_of(verdict, needs_texture=False, found_by=FoundBy.HOUGH):
    return Attempt(Hypothesis(found_by, None, needs_texture=needs_texture), verdict)


def test_the_accepted_attempt_answers_else_the_last_decisive_refusal():
    accepted, refused = attempt_of(Verdict.ACCEPTED), attempt_of(Verdict.REFUSED)
    second = attempt_of(Verdict.REFUSED)
    guided = attempt_of(Verdict.REFUSED, needs_texture=True)
    gave_up = attempt_of(Verdict.NOT_FITTED, found_by=FoundBy.SURFACE)
    surface = attempt_of(Verdict.REFUSED, found_by=FoundBy.SURFACE)
    assert choose([refused, guided, accepted]) is accepted
    assert choose([refused, second, guided, gave_up]) is second
    assert choose([refused, guided, surface]) is surface
    assert choose([guided, gave_up]) is None
    assert choose([]) is None


def test_what_is_remembered_of_a_frame_is_light(textured):
    scene, images = textured
    calibrator = Calibrator(scene.rig)
    result = calibrator.add(*images)
    assert calibrator.estimate.attempts == ()
    assert [term.name for term in calibrator.estimate.uncertainty] == [
        term.name for term in result.uncertainty
    ]
    slim = result.attempts[0].slim()
    assert slim.pattern is None and slim.genetic is None
    assert slim.hypothesis.other_lines is None and slim.hypothesis.locating_texture is None
    assert slim.verdict is Verdict.ACCEPTED and slim.readings == result.gates


def test_lines_alone_make_one_attempt_for_each_pair_of_the_first_choice(textured, monkeypatch):
    scene, images = textured
    raise_lines(monkeypatch, 0.07)
    result = Calibrator(scene.rig, LINES_ALONE).add(*images)
    assert {attempt.found_by for attempt in result.attempts} == {FoundBy.HOUGH}
    assert result.reason is RejectReason.STAGES_DISAGREE
