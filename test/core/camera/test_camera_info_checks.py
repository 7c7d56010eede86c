"""What is said of a CameraInfo that is strange, and that nothing is said of one that is not."""

from types import SimpleNamespace

import pytest

from stereo_selfcal.core.camera.camera_info import CameraInfoError, CameraModel, InfoReason
from stereo_selfcal.core.camera.camera_info_checks import find_unusual_values
from stereo_selfcal.core.camera.rectifier import StereoRectifier

D = [-0.3, 0.1, 0.0, 0.0, 0.0]
R = [0.9999, 0.01, 0.01, -0.01, 0.9999, 0.0, -0.01, 0.0, 0.9999]
EYE = [1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0]


def info(side="left", **changes):
    """Return a CameraInfo like KITTI's: K differs from P, D is not zero."""
    k = [984.0, 0, 690.0, 0, 980.0, 233.0, 0, 0, 1]
    shift = -721.5 * 0.54 if side == "right" else 0.0
    p = [721.5, 0, 609.5, shift, 0, 721.5, 172.8, 0, 0, 0, 1, 0]
    values = {"width": 1242, "height": 375, "distortion_model": "plumb_bob", "k": k, "d": D, "r": R, "p": p}
    return SimpleNamespace(**{**values, **changes})


def doubts(rectified=True, baseline_m=0.54, **changes):
    cameras = CameraModel.read(info(**changes), "left"), CameraModel.read(info("right"), "right")
    return {
        finding.reason: finding.message for finding in find_unusual_values(*cameras, baseline_m, rectified)
    }


def changed(values, **by_index):
    return [by_index.get(f"i{i}", value) for i, value in enumerate(values)]


@pytest.mark.parametrize("rectified", [True, False])
def test_nothing_is_said_of_a_good_one(rectified):
    assert doubts(rectified) == {}


@pytest.mark.parametrize(
    ("baseline_m", "usual"), [(0.031, True), (0.029, False), (1.99, True), (2.01, False)]
)
def test_usual_baselines(baseline_m, usual):
    assert (InfoReason.BASELINE_UNUSUAL not in doubts(baseline_m=baseline_m)) == usual


@pytest.mark.parametrize(
    ("baseline_m", "possible"), [(0.0051, True), (0.0049, False), (9.9, True), (10.1, False), (540.0, False)]
)
def test_possible_baselines(baseline_m, possible):
    """P[3] in millimetres makes a rig of half a kilometre: every height would be wrong by as much."""
    right = info("right")
    right.p[3] = -721.5 * baseline_m
    if possible:
        assert StereoRectifier.from_camera_info(info(), right).rig.baseline_m == pytest.approx(baseline_m)
        return
    with pytest.raises(CameraInfoError, match="pixels times metres") as caught:
        StereoRectifier.from_camera_info(info(), right)
    assert caught.value.reason is InfoReason.BASELINE_IMPLAUSIBLE


@pytest.mark.parametrize(("fx", "usual"), [(360.0, False), (361.5, True), (1440.0, True), (1445.0, False)])
def test_focal_lengths_of_k_and_p(fx, usual):
    k = changed(info().k, i0=fx, i4=fx)
    assert (InfoReason.FOCAL_LENGTHS_DISAGREE not in doubts(k=k)) == usual


def test_fisheye_lenses_are_zoomed_more():
    k = changed(info().k, i0=300.0, i4=300.0)
    assert InfoReason.FOCAL_LENGTHS_DISAGREE in doubts(k=k)
    assert doubts(k=k, distortion_model="equidistant") == {}


@pytest.mark.parametrize("matrix", ["k", "p"])
def test_principal_point_at_the_rim(matrix):
    """Half the resolution in K or P alone, or the row of another crop."""
    index = {"k": "i5", "p": "i6"}[matrix]
    for row, usual in ((330.0, False), (310.0, True), (50.0, False), (60.0, True)):
        found = doubts(**{matrix: changed(getattr(info(), matrix), **{index: row})})
        assert (InfoReason.PRINCIPAL_POINT not in found) == usual, row


def test_crop_may_have_its_principal_point_anywhere():
    roi = SimpleNamespace(x_offset=0, y_offset=150, width=1242, height=225)
    assert doubts(roi=roi) == {}


@pytest.mark.parametrize(
    ("changes", "rectified", "said"),
    [
        ({}, True, True),
        ({"d": [0.0] * 5}, True, False),
        ({"d": []}, True, False),
        ({"r": R}, True, False),
        ({"p": info().p}, True, False),
        ({}, False, False),  # raw images of aligned cameras
    ],
)
def test_calibration_of_a_single_raw_camera_on_a_rectified_topic(changes, rectified, said):
    k = info().k
    p = [*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0]
    found = doubts(rectified, **{"k": k, "p": p, "r": EYE, "d": D, **changes})
    assert (InfoReason.SEEMS_UNRECTIFIED in found) == said
    if said:
        assert "set rectified: false" in found[InfoReason.SEEMS_UNRECTIFIED]
