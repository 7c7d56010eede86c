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

"""Drives that are drawn are what they are said to be: the rides, the errors of their frames, the verdicts."""

import math

import numpy as np
import pytest

from benchmarks.mount_drives.draws import Kind, drawn
from benchmarks.mount_drives.frame_errors import FrameError
from benchmarks.mount_drives.judged import USUAL, Judged, cells_of
from benchmarks.mount_drives.rides import STEP_S, Ride, driven, oscillation, wander
from stereo_selfcal import Calibrator, StereoRig
from stereo_selfcal.core.geometry.uncertainty import UncertaintyTerm

RIG = StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481)
STILL = Ride(np.zeros(3), 1.0)


def frame(**stds):
    """Return a frame with so many millimetres and milliradians of each cause."""
    terms = tuple(UncertaintyTerm(name, np.eye(3) * (std * 1e-3) ** 2) for name, std in stds.items())
    return FrameError("paper", "0", RIG, np.array([1.3, 0.05, 0.0]), np.zeros(3), np.zeros(3), terms)


def errors(kind, seed, **stds):
    drive = drawn(kind, [frame(**stds)], np.random.default_rng(seed))
    poses = [each.extrinsics.as_array() for each in drive.results if each.accepted]
    return np.array(poses) - drive.mount.as_array()


def test_motion_has_its_size_and_its_memory():
    rng = np.random.default_rng(1)
    lag = round(1.5 / STEP_S)
    for process in (wander, lambda n, memory, rng: oscillation(n, memory, 1.0 / 1.5, rng)):
        values = process(100_000, 1.5, rng)
        assert values.std() == pytest.approx(1.0, abs=0.1)
        # After its memory, and after a whole oscillation, the amplitude has fallen to 1 / e.
        assert np.mean(values[:-lag] * values[lag:]) == pytest.approx(math.exp(-1.0), abs=0.1)


def test_car_dives_when_it_brakes_and_comes_to_rest():
    drive = driven(Ride(np.zeros(3), 1.0, stops=True), 40.0, np.random.default_rng(2))
    still = np.flatnonzero(drive.standing)
    assert len(still) > 5.0 / STEP_S
    assert math.degrees(drive.motion[: still[0], 1].max()) > 0.1
    rest = drive.motion[still[len(still) // 2]]
    assert np.ptp(drive.motion[still[len(still) // 2] : still[-1]], axis=0) == pytest.approx(0.0, abs=1e-4)
    assert abs(math.degrees(rest[1])) < 0.3


def test_frames_are_as_wrong_as_they_say():
    kind = Kind(STILL, 1.0, 2.0, bad_part=0.0, gaps=False, measured=False)
    first = np.array([errors(kind, seed, noise=3.0, camber=4.0, vergence=12.0)[0] for seed in range(400)])
    np.testing.assert_allclose(np.sqrt(np.mean(first**2, axis=0)), 13e-3, rtol=0.12)


def test_rig_is_the_same_in_all_frames_and_noise_in_none():
    kind = Kind(STILL, 20.0, 5.0, bad_part=0.0, gaps=False, measured=False)
    assert np.ptp(errors(kind, 3, vergence=5.0), axis=0).max() < 1e-9
    assert errors(kind, 3, noise=5.0).std(axis=0) == pytest.approx(5e-3, rel=0.25)
    # The profile changes within seconds, the cross-section does not.
    assert (
        np.ptp(errors(kind, 3, camber=5.0), axis=0).max()
        < np.ptp(errors(kind, 3, roughness=5.0), axis=0).min()
    )


def test_standing_car_sees_one_road():
    kind = Kind(Ride(USUAL.size, 1.5, stands=True), 12.0, 5.0, bad_part=0.0, gaps=False, measured=False)
    assert np.ptp(errors(kind, 4, roughness=5.0), axis=0).max() < 1e-9
    drive = drawn(kind, [frame(noise=1.0)], np.random.default_rng(4))
    calibrator = Calibrator(RIG)
    stood = [calibrator.remember(each).stood for each in drive.results]
    assert stood == [False, *[True] * (len(stood) - 1)]
    moving = drawn(Kind(STILL, 5.0, 5.0), [frame(noise=1.0)], np.random.default_rng(4))
    calibrator = Calibrator(RIG)
    assert not any(calibrator.remember(each).stood for each in moving.results)


def test_part_of_the_frames_is_bad_and_part_refused():
    kind = Kind(STILL, 400.0, 5.0, measured=False)
    drive = drawn(kind, [frame(noise=1.0)], np.random.default_rng(5))
    refused = np.array([not each.accepted for each in drive.results])
    assert 0.1 < refused.mean() < 0.4
    assert drive.bad[~refused].mean() == pytest.approx(0.1, abs=0.03)
    far = np.abs(errors(kind, 5, noise=1.0))[:, 1] > math.radians(0.18)
    assert far.mean() == pytest.approx(0.1, abs=0.03)


@pytest.mark.parametrize(("factor", "met"), [(1.0, "yes"), (9.0, "**no**"), (0.3, "**no**")])
def test_too_certain_and_too_doubtful_mounts_are_seen(factor, met):
    rng = np.random.default_rng(6)
    std = np.array([5.0, 0.05, 0.1])
    group = [Judged({}, factor * std * rng.normal(size=3), std, std, 10) for _ in range(100)]
    assert cells_of(group)[-1] == met
