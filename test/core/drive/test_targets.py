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

"""Targets of an estimate: when they are reached, and what keeps it from them, in words."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from stereo_selfcal import CalibrationResult, Extrinsics
from stereo_selfcal.core.drive import targets as module
from stereo_selfcal.core.drive.targets import (
    USUAL_TARGETS,
    EstimateTimes,
    Targets,
    describe_std,
    explain_shortfall,
    is_less_certain,
)
from stereo_selfcal.core.evidence.rig_unknowns import RIG_TERMS
from stereo_selfcal.core.geometry.mount import MountEvidence
from stereo_selfcal.core.geometry.uncertainty import TERMS, UncertaintyTerm, total_covariance
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.results import rejected

POSE = Extrinsics(1.4, 0.05, -0.01)
DEG = np.pi / 180.0
ASKED = Targets(0.015, 0.15 * DEG, 0.35 * DEG)
MOUNT = MountEvidence(
    12.0, 1, 0, False, Extrinsics(5e-3, 0.003, 0.004), np.array([1.5, 1.5, 3.0]), np.array([8.0, 5.0, 2.5])
)


def estimate(n_frames=14, mount=None, **stds):
    """Return an estimate; each term is given by its name and three standard deviations [m, deg, deg]."""
    terms = tuple(
        UncertaintyTerm(name, np.diag((np.array(std) * (1.0, DEG, DEG)) ** 2)) for name, std in stds.items()
    )
    return CalibrationResult(
        "good", None, POSE, total_covariance(terms), uncertainty=terms, n_frames=n_frames, mount=mount
    )


GOOD = estimate(noise=(0.015, 0.149, 0.3499))


def test_reached_at_the_target_itself_and_not_beyond():
    assert ASKED.reached(GOOD)
    for beyond in ((0.0151, 0.1, 0.1), (0.01, 0.151, 0.1), (0.01, 0.1, 0.351)):
        assert not ASKED.reached(estimate(noise=beyond))
    assert replace(ASKED, frames=14).reached(GOOD)
    assert not replace(ASKED, frames=15).reached(GOOD)


def test_zero_asks_for_nothing():
    anything = Targets()
    assert anything.any_std and not ASKED.any_std
    assert anything.reached(estimate(noise=(1.0, 5.0, 5.0)))
    assert replace(ASKED, roll_std_rad=0.0).reached(estimate(noise=(0.01, 0.1, 5.0)))
    assert not replace(anything, frames=2).reached(estimate(n_frames=1, noise=(0.01, 0.1, 0.1)))


def test_as_people_read_it():
    assert ASKED.describe() == "15 mm, 0.15, 0.35 deg"
    assert Targets(0.0, 0.15 * DEG, 0.0).describe() == "any, 0.15 deg, any"
    assert Targets().describe() == "any, any, any"
    assert describe_std(Extrinsics(0.1234, 0.149 * DEG, 0.3 * DEG)) == "120 mm, 0.15, 0.3 deg"


@pytest.mark.parametrize(
    ("terms", "words"),
    [
        (
            {"motion": (0.004, 0.2, 0.2), "noise": (0.001, 0.1, 0.1)},
            "the pitch has a std of 0.224 deg, asked 0.15 deg: 80% of its variance is motion of the car "
            "(motion of the car over its road): drive longer",
        ),
        (
            {"noise": (0.03, 0.1, 0.1), "roughness": (0.01, 0.1, 0.1)},
            "the height has a std of 31.6 mm, asked 15 mm: 90% of its variance is few frames (14 accepted; "
            "noise of the pixels): more frames average it out",
        ),
        (
            {"crown": (0.01, 0.1, 0.3), "roughness": (0.001, 0.1, 0.4), "noise": (0.01, 0.01, 0.35)},
            "is the road (unevenness of the road along the lane): the same road does not average it out",
        ),
        (
            {"row_offset": (0.01, 0.1, 0.3), "vergence": (0.01, 0.1, 0.25)},
            "the roll has a std of 0.391 deg, asked 0.35 deg: 100% of its variance is the rig's part (offset "
            "between the rows of both images that the calibration leaves): it does not average out: "
            "drive where the road has texture, or raise target_roll_std_rad",
        ),
        (
            {"vergence": (0.01, 0.1, 0.5), "synchronisation": (0.01, 0.1, 0.1)},
            "calibration leaves): it does not average out: raise target_roll_std_rad",
        ),
        ({"standing": (0.01, 0.3, 0.3)}, "is a car that stands ("),
        ({"of_a_later_version": (0.01, 0.3, 0.3)}, "few frames (14 accepted; of a later version)"),
    ],
)
def test_the_worst_component_and_its_greatest_cause_are_named(terms, words):
    assert words in explain_shortfall(estimate(**terms), ASKED)


def test_the_rig_is_named_where_its_part_alone_is_too_much():
    """Most is motion, but to drive longer cannot help."""
    terms = {"motion": (0.0, 0.4, 0.0), "vergence": (0.0, 0.2, 0.0)}
    assert "20% of its variance is the rig's part" in explain_shortfall(estimate(**terms), ASKED)
    terms["vergence"] = (0.0, 0.1499, 0.0)
    assert "is motion of the car" in explain_shortfall(estimate(**terms), ASKED)


def test_motion_is_told_in_moments():
    told = explain_shortfall(estimate(mount=MOUNT, motion=(0.0, 0.2, 0.0)), ASKED)
    assert told.endswith("(12 s of drive show 5.0 independent moments of it): drive longer")


def test_too_few_frames_and_nothing_missing():
    assert explain_shortfall(GOOD, ASKED) == ""
    few = "14 of at least 20 frames accepted: drive longer"
    assert explain_shortfall(GOOD, replace(ASKED, frames=20)) == few
    both = explain_shortfall(estimate(motion=(0.0, 0.2, 0.0)), replace(ASKED, frames=20))
    assert both.startswith(f"{few}; the pitch has a std of 0.2 deg")


def test_without_terms_or_without_a_calibration():
    bare = replace(GOOD, covariance=GOOD.covariance * 4.0, uncertainty=())
    assert explain_shortfall(bare, ASKED) == "the height has a std of 30 mm, asked 15 mm: drive longer"
    refusal = rejected(Rejection(RejectReason.NO_LINES_FOUND, "lines found", 0, Bound.LEAST, 2, "", "drive"))
    assert explain_shortfall(refusal, ASKED) == refusal.message
    assert not ASKED.reached(refusal)


def test_every_term_has_a_cause_and_those_of_the_rig_are_the_rigs():
    assert set(TERMS) == set(module._CAUSES)
    assert {module._CAUSES[name] for name in RIG_TERMS} == {module._Cause.RIG}
    assert set(module._Cause) == set(module._LABELS)


@pytest.mark.parametrize(
    ("old", "new", "less"),
    [
        ((0.010, 0.30, 0.10), (0.014, 0.20, 0.30), True),  # the pitch keeps a user waiting
        ((0.010, 0.20, 0.10), (0.001, 0.20, 0.01), False),  # equal where it counts
        ((0.010, 0.20, 0.10), (0.001, 0.21, 0.01), False),
        ((0.010, 0.202, 0.10), (0.010, 0.2001, 0.10), False),  # not by a hundredth
        ((0.010, 0.203, 0.10), (0.010, 0.2, 0.10), True),
    ],
)
def test_the_component_farthest_from_its_target_says_which_is_less_certain(old, new, less):
    assert is_less_certain(estimate(noise=old), estimate(noise=new), ASKED) is less


def test_less_certain_where_some_or_all_are_any():
    wide, narrow = estimate(noise=(0.01, 0.5, 0.1)), estimate(noise=(0.01, 0.1, 0.2))
    assert is_less_certain(wide, narrow, Targets())
    assert is_less_certain(wide, narrow, USUAL_TARGETS)
    assert not is_less_certain(wide, narrow, replace(ASKED, pitch_std_rad=0.0))


def test_what_does_not_hold_the_motion_is_less_certain():
    """A file of one frame says 0.0003 deg."""
    frame = estimate(noise=(1e-4, 0.0003, 0.005))
    mount = estimate(mount=MOUNT, motion=(0.004, 0.06, 0.08))
    assert is_less_certain(frame, mount, ASKED)
    assert not is_less_certain(mount, frame, ASKED)


def test_estimates_become_rarer_and_none_of_the_first_frames_is_passed_over():
    times = EstimateTimes()
    looks = [index for index in range(1, 3000) if times.count()]
    assert times.accepted == 2999
    assert looks[:50] == list(range(1, 51))
    assert len(looks) < 300
    assert max(b / a for a, b in pairwise(looks[50:])) < 1.05


def test_estimate_is_made_with_the_fewest_frames_that_are_asked_for():
    times = EstimateTimes(frames=700)
    assert 700 in [index for index in range(1, 1000) if times.count()]
