"""Result files for tests."""

import dataclasses

import numpy as np

from stereo_selfcal import CalibrationResult, Extrinsics, StereoRig
from stereo_selfcal.files.result_file import write_result

RIG = StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481)
# Awkward on purpose: no short decimal, and so small that repr() has an exponent without a point.
EXTRINSICS = Extrinsics(1 / 3, 1e-05, -2 / 7)
COVARIANCE = np.diag([1e-6, 1e-10, 4e-8])


def a_result(**changes):
    result = CalibrationResult(
        "fine", extrinsics=EXTRINSICS, covariance=COVARIANCE, stamp_s=1_700_000_000.123456789, n_frames=3
    )
    return dataclasses.replace(result, **changes)


def write(path, result=None, source="bags/straight_road", **options):
    write_result(path, result or a_result(), RIG, source=source, seed=7, **options)
