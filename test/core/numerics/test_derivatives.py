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

import numpy as np
import pytest

from stereo_selfcal.core.numerics.derivatives import central_difference, linearise, point_by_point

AT = np.array([0.3, -2.0, 5.0])


def function(points):
    """Return (B, 2): exp(a) b and c^2 + sin(b)."""
    a, b, c = points.T
    return np.stack([np.exp(a) * b, c**2 + np.sin(b)], axis=1)


def derivative(point):
    a, b, c = point
    return np.array([[np.exp(a) * b, 0.0], [np.exp(a), np.cos(b)], [0.0, 2.0 * c]])


def test_derivative_of_a_known_function():
    assert central_difference(function, AT, 1e-5) == pytest.approx(derivative(AT), abs=1e-9)


def test_each_number_has_a_step_of_its_own():
    assert central_difference(function, AT, [1e-6, 1e-4, 1e-3]) == pytest.approx(derivative(AT), abs=1e-8)


def test_exact_for_a_parabola_whatever_the_step():
    assert central_difference(lambda p: p[:, 0] ** 2, np.array([3.0]), 0.5) == pytest.approx([6.0])


def test_error_grows_with_the_square_of_the_step():
    errors = [
        abs(float(central_difference(lambda p: p[:, 0] ** 3, np.ones(1), s)[0]) - 3.0) for s in (0.1, 0.2)
    ]
    assert errors == pytest.approx([0.01, 0.04])


def test_all_points_come_in_one_call():
    shapes = []

    def count(points):
        shapes.append(points.shape)
        return function(points)

    central_difference(count, AT, 1e-5)
    linearise(count, AT, 1e-5)
    assert shapes == [(6, 3), (7, 3)]


def test_a_number_without_a_step_is_held():
    shapes = []

    def count(points):
        shapes.append(points.shape)
        return function(points)

    value, jacobian = linearise(count, AT, [1e-5, 0.0, 1e-5])
    assert shapes == [(5, 3)]
    assert np.all(jacobian[1] == 0.0)
    assert jacobian[[0, 2]] == pytest.approx(derivative(AT)[[0, 2]], abs=1e-8)
    assert value == pytest.approx(function(AT[None])[0])


def test_values_may_have_any_shape():
    at = np.array([2.0, 7.0])
    jacobian = central_difference(lambda p: p[:, :, None, None] * np.ones((3, 4)), at, 1e-3)
    assert jacobian.shape == (2, 2, 3, 4)
    assert jacobian[:, :, 1, 2] == pytest.approx(np.eye(2))


def test_a_function_of_one_point_at_a_time():
    one = point_by_point(lambda point: float(point @ point))
    assert central_difference(one, AT, 1e-4) == pytest.approx(2.0 * AT)


def test_steps_and_point_stay_what_they_were():
    at, steps = AT.copy(), np.full(3, 1e-5)
    linearise(function, at, steps)
    assert at.tolist() == AT.tolist()
    assert steps.tolist() == [1e-5] * 3
