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

"""Whether the car stands: by landmarks whose motion is known, and by images of a street."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from landmark_making import RIG, START, cloud, seen
from street_making import Place, along, street_pair

from stereo_selfcal import Calibrator, StereoRig
from stereo_selfcal.core.drive.standing import PlaceOfCar


@pytest.fixture(scope="module")
def world():
    return cloud(np.random.default_rng(0))


def stood(world, ways_m, refused=(), unseen=()):
    """Return for each frame whether the car stood since the accepted frame before it."""
    place, told = PlaceOfCar(), []
    for index, way_m in enumerate(ways_m):
        landmarks = seen(world, RIG, along(START, way_m), np.random.default_rng(index))
        place = place.followed_by(None if index in unseen else landmarks, RIG)
        told.append(place.stands)
        if index not in refused:
            place = place.accepted()
    return told


def test_the_first_frame_of_a_stop_does_not_know_it(world):
    assert stood(world, [0.0, 0.0, 0.0, 0.0]) == [False, True, True, True]


def test_a_car_that_drives_does_not_stand(world):
    assert stood(world, [0.0, 1.0, 2.0, 3.0]) == [False] * 4
    assert stood(world, [0.0, 0.0, 1.0, 1.0, 2.0]) == [False, True, False, True, False]


def test_a_slow_car_moves_away_from_its_place(world):
    """Two centimetres from frame to frame are as nothing; from the first frame of the place they add up."""
    told = stood(world, np.arange(16) * 0.02)
    assert not told[0] and any(told)
    assert 3 <= told[1:].count(False) <= 7


def test_refused_frames_neither_end_nor_hide_a_stop(world):
    assert stood(world, [0.0, 0.0, 0.0], refused=[1]) == [False, True, True]
    assert stood(world, [0.0, 1.0, 1.0, 1.0], refused=[1]) == [False, False, False, True]
    # Moved away and back while frames were refused: it is another stop.
    assert stood(world, [0.0, 2.0, 0.0, 0.0], refused=[1]) == [False, False, False, True]


def test_a_car_is_not_said_to_stand_at_a_frame_that_does_not_show_it(world):
    """A lorry before the camera does not move the car; what is seen after it, and before, does."""
    assert stood(world, [0.0, 0.0, 0.0, 0.0], unseen=[1]) == [False, False, True, True]
    assert stood(world, [0.0, 1.0, 1.0, 1.0], unseen=[1]) == [False, False, False, True]
    assert stood(world, [0.0] * 3, unseen=[0, 1, 2]) == [False] * 3


def test_a_car_that_leaves_its_place_unseen_does_not_stand_elsewhere(world):
    """Each frame shows something else than the first one; the third one continues the second one."""
    other = world.moved(1.0, 30.0)
    place = PlaceOfCar().followed_by(seen(world, RIG, START, np.random.default_rng(0)), RIG).accepted()
    for index, way_m in enumerate((0.0, 1.0, 1.0)):
        there = seen(other, RIG, along(START, way_m), np.random.default_rng(1 + index))
        place = place.followed_by(there, RIG)
        assert place.stands == (index == 2)
        place = place.accepted()


def test_the_same_image_again_is_of_a_standing_car(world):
    """As of a simulation without noise: landmarks that did not move at all leave no error to go by."""
    there = seen(world, RIG, START, np.random.default_rng(1))
    place = PlaceOfCar().followed_by(there, RIG).accepted()
    assert place.followed_by(copy.deepcopy(there), RIG).stands


def test_other_cars_do_not_move_this_one(world):
    place = PlaceOfCar().followed_by(seen(world, RIG, START, np.random.default_rng(1)), RIG).accepted()
    for part, still in ((0.25, True), (1.0, False)):
        there = seen(world.moved(part, 1.5), RIG, START, np.random.default_rng(2))
        assert place.followed_by(there, RIG).stands == still


# --- images ----------------------------------------------------------------------------------------------

STREET_RIG = StereoRig(620, 188, 360.0, 360.0, 305.0, 90.0, 0.54)
AT = Place(yaw_rad=0.01, pitch_rad=0.035, roll_rad=0.01)


def driven(ways_m):
    """Return a calibrator and the results of frames of a street; the noise of each is its own."""
    calibrator = Calibrator(STREET_RIG)
    results = [
        calibrator.add(*street_pair(STREET_RIG, along(AT, way_m), seed=index), 100.0 + 0.5 * index)
        for index, way_m in enumerate(ways_m)
    ]
    assert all(result.accepted for result in results), [result.message for result in results]
    return calibrator, results


@pytest.fixture(scope="module")
def waiting():
    return driven([0.0] * 3)


@pytest.mark.slow
def test_images_of_a_standing_car_differ_by_their_noise_alone(waiting):
    calibrator, results = waiting
    assert [result.stood for result in results] == [False, True, True]
    estimate = calibrator.estimate
    assert estimate.mount.stood and "3 frames in 1.0 s of a standing car" in estimate.message
    names = {term.name for term in estimate.uncertainty}
    assert "standing" in names and "motion" not in names


@pytest.mark.slow
def test_images_of_a_moving_car_are_not_of_a_standing_one():
    calibrator, results = driven([0.0, 0.6])
    assert [result.stood for result in results] == [False, False]
    estimate = calibrator.estimate
    assert not estimate.mount.stood and "standing" not in estimate.message
    names = {term.name for term in estimate.uncertainty}
    assert "motion" in names and "standing" not in names


@pytest.mark.slow
def test_copies_of_a_calibrator_know_that_the_car_stands(waiting):
    calibrator, _ = waiting
    next_frame = calibrator.calibrate_frame(*street_pair(STREET_RIG, AT, seed=9), 103.0)
    for copied in (copy.deepcopy(calibrator), pickle.loads(pickle.dumps(calibrator))):
        assert copied.estimate.message == calibrator.estimate.message
        assert copied.remember(next_frame).stood
        assert copied.estimate.n_frames == calibrator.estimate.n_frames + 1


@pytest.mark.slow
def test_whether_the_car_stood_is_decided_by_who_remembers(waiting):
    """A frame that was calibrated elsewhere brings its landmarks, and no opinion."""
    _, results = waiting
    calibrator = Calibrator(STREET_RIG)
    kept = [calibrator.remember(replace(each, stood=not each.stood)) for each in results]
    assert [each.stood for each in kept] == [each.stood for each in results]
