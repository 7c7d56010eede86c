"""The camera against the direction of travel in the result file: written, checked, restored, or not there."""

import dataclasses
import math

import numpy as np
import pytest
from result_making import a_mount, a_result

from stereo_selfcal.core.geometry.travel import Travel
from stereo_selfcal.files.result_file import result_parameters, yaw_parameters

# Awkward on purpose, as result_making.EXTRINSICS.
COVARIANCE = np.array([[4e-6, -1e-07 / 3], [-1e-07 / 3, 9e-6]])
TRAVEL = Travel(-1 / 30, 1e-05, COVARIANCE, 41, 4 / 3, 25.5)
NOT_KNOWN = dataclasses.replace(TRAVEL, covariance=np.diag([math.radians(1.0) ** 2, 9e-6]))


def test_parameters_have_the_names_of_the_contract():
    assert yaw_parameters(a_result(travel=TRAVEL)) == {
        "extrinsics.yaw_rad": -1 / 30,
        "extrinsics.yaw_std_rad": 0.002,
    }
    assert list(result_parameters(a_mount(travel=TRAVEL))) == list(result_parameters(a_mount()))


@pytest.mark.parametrize(
    "travel",
    [
        None,
        NOT_KNOWN,
        dataclasses.replace(TRAVEL, yaw_rad=math.nan),
        dataclasses.replace(TRAVEL, covariance=np.full((2, 2), math.inf)),
    ],
)
def test_yaw_that_is_not_known_has_no_parameters(travel):
    assert yaw_parameters(a_result(travel=travel)) == {}
