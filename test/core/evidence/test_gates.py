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

"""Every gate from both sides of its limit, with value, threshold, reason and remedy."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from refusal_words import assert_says_everything

from stereo_selfcal import CalibratorConfig, Extrinsics, RejectReason
from stereo_selfcal.core.estimators.coarse_road import CoarseRoad
from stereo_selfcal.core.estimators.lane_sweep import LaneSweep
from stereo_selfcal.core.estimators.line_covariance import Bends, LineFit
from stereo_selfcal.core.estimators.stripe_fit import StripeFit
from stereo_selfcal.core.estimators.texture_fit import TextureFit, TextureQuality
from stereo_selfcal.core.evidence.camera_turn import CameraTurn
from stereo_selfcal.core.evidence.camera_yaw import YawTold
from stereo_selfcal.core.evidence.frame_evidence import Contradictor, Evidence
from stereo_selfcal.core.evidence.gates import GATES, evaluate_gates
from stereo_selfcal.core.evidence.kerb_face import EdgeStep
from stereo_selfcal.core.evidence.profile import Profile
from stereo_selfcal.core.evidence.stripe_border import StripeBorder
from stereo_selfcal.core.evidence.synchronisation import Lateness
from stereo_selfcal.core.geometry.uncertainty import UncertaintyTerm
from stereo_selfcal.core.lanes.line_geometry import BelowPlane, HeightOverLane
from stereo_selfcal.core.rejection import Bound
from stereo_selfcal.core.road.unevenness import RoadUnevenness

CONFIG = CalibratorConfig()
NOTHING = np.empty(0)
POSE = Extrinsics(1.5, 0.02, -0.01)
STRAIGHT = Bends(0.0, 1e-6, 0.0, 1e-6)
LINES = LineFit(np.eye(3) * 1e-8, 0.0, 2.0, np.zeros((3, 8)))
FLAT = Profile(NOTHING, NOTHING, NOTHING, np.zeros(2), np.diag([1e-3, 1e-4]) ** 2)
PLACES, WIDTHS = np.array([1.7, -1.8]), np.array([0.15, 0.12])
REFINED = StripeFit(
    POSE, np.eye(3) * 1e-8, 0.0, 0.0, PLACES, WIDTHS, np.zeros(2), np.full(2, 0.5), 2.0, 1.0, 50, None
)
ASPHALT = TextureFit(
    POSE,
    (UncertaintyTerm("noise", np.eye(3) * 1e-8),),
    TextureQuality(50.0, 0.9, 0.9, 0.9, (1e-3, 1e-4, 1e-4)),
    RoadUnevenness(0.0, 0.0, 0.0),
    NOTHING,
    NOTHING,
    NOTHING,
    NOTHING,
    halves=((np.zeros(3), np.full(3, 1e-4)), (np.array([0.01, 0.0, 0.0]), np.full(3, 1e-4))),
)


DENSE = CoarseRoad(POSE, np.diag([0.01, 1e-3, 2e-3]) ** 2, share=0.8, matched_share=0.9, scale=2)


def swept(*planes, elsewhere=0.0):
    """Return a sweep in which both images agree under (height, roll) by so many standard deviations."""
    heights_m, rolls_rad = np.linspace(1.0, 2.0, 101), np.linspace(-0.15, 0.15, 61)
    sigmas = np.full((101, 61), elsewhere)
    for height_m, roll_rad, of_plane in planes:
        sigmas[np.argmin(np.abs(heights_m - height_m)), np.argmin(np.abs(rolls_rad - roll_rad))] = of_plane
    return LaneSweep(heights_m, rolls_rad, sigmas)


def rows_off(pitch_deg, std_deg=0.002, roll_deg=0.0, roll_std_deg=0.002):
    """Return a right camera that is turned in pitch and roll, as rows tell it."""
    stds = np.radians([std_deg, roll_std_deg])
    return CameraTurn(math.radians(pitch_deg), math.radians(roll_deg), np.diag(stds**2))


def over(*values_m, std_m=0.0):
    return tuple(HeightOverLane(value_m, std_m) for value_m in values_m)


GOOD = Evidence(
    config=CONFIG,
    genetic=POSE,
    fitness=9000.0,
    misfit_px=0.01,
    below=BelowPlane(),
    bends=STRAIGHT,
    lines=LINES,
    refined=REFINED,
    profile=FLAT,
    wide_profile=FLAT,
    clipped=0.01,
    texture_sufficiency=3.0,
    texture=ASPHALT,
    surface_heights=over(0.0, 0.0),
    lane_heights=over(0.0, 0.0, std_m=0.005),
    rows=rows_off(0.01),
    borders=(
        StripeBorder(0.01, 0.002, edge_step=EdgeStep(0.002, 0.003)),
        StripeBorder(-0.02, 0.002, edge_step=EdgeStep(0.004, 0.02)),
    ),
    stripes_fitted=True,
    inner_line_height=HeightOverLane(0.005, 0.002),
    std=np.array([0.003, 1e-4, 1e-3]),
    contradictors=(Contradictor(POSE, np.diag([0.004, 2e-4, 1.5e-3]) ** 2),),
    yaw=YawTold(math.radians(0.01), math.radians(0.005)),
    wrong_yaw_rad=math.radians(0.05),
    own_strip=ASPHALT,
    kerb_heights=(HeightOverLane(0.01, 0.005), HeightOverLane(-0.01, 0.005)),
    coarse=DENSE,
    sweeps=(swept((POSE.height_m, POSE.roll_rad, 9.0)),),
    lateness=Lateness(0.01, 0.02, clear=True),
    most_way_m=0.1,
)
MM, DEG = 1e3, math.degrees(1.0)


def refusal(**changes):
    """Return the refusal of evidence that is good but for the changes."""
    return evaluate_gates(replace(GOOD, **changes))[1]


def assert_refuses(rejection, reason, value, threshold, *words):
    assert rejection.reason is reason
    assert rejection.value == pytest.approx(value)
    assert rejection.threshold == pytest.approx(threshold)
    assert_says_everything(rejection, *words)


def moved(axis, by):
    pose = POSE.as_array()
    pose[axis] += by
    return Extrinsics.from_array(pose)


def test_good_evidence_passes_every_gate_once():
    readings, rejection = evaluate_gates(GOOD)
    assert rejection is None
    assert [(each.name, each.label) for each in readings] == [(gate.key, gate.label) for gate in GATES]
    assert all(reading.passed and math.isfinite(reading.value) for reading in readings)
    assert all(is_good(reading) for reading in readings)


def is_good(reading):
    """Whether a value is on the good side of its limit, by the bound that the reading names."""
    if reading.bound is Bound.LEAST:
        return reading.value >= reading.threshold
    return reading.bound is Bound.MOST and reading.value <= reading.threshold


def test_names_are_unique_and_every_gate_has_a_remedy():
    assert len({gate.key for gate in GATES}) == len({gate.label for gate in GATES}) == len(GATES)
    assert all(re.fullmatch(r"[a-z]+(_[a-z]+)*", gate.key) for gate in GATES)
    assert all(gate.remedy for gate in GATES)


BAD = {
    "plausible": {"genetic": replace(POSE, roll_rad=CONFIG.search.roll_max_rad)},
    "fitness": {"fitness": 0.5},
    "straight": {"bends": replace(STRAIGHT, lateral_per_m=0.01)},
    "flat": {"bends": replace(STRAIGHT, vertical_per_m=0.01)},
    "nothing_below": {"below": BelowPlane(0.1)},
    "determined": {"lines": None},
    "consistent": {"lines": replace(LINES, chi2=200.0)},
    "stages_agree": {"genetic": replace(POSE, height_m=1.6)},
    "stripe_width": {"refined": replace(REFINED, widths_m=np.array([0.2, 0.04]))},
    "lane_width": {"refined": replace(REFINED, positions_m=np.array([0.2, -1.0]))},
    "near_and_far": {"wide_profile": replace(FLAT, change=np.array([0.1, 0.0]))},
    "sharp": {"refined": replace(REFINED, blur_px=np.array([2.95, 0.5]))},
    "exposed": {"clipped": 0.6},
    "texture_sufficient": {"texture_sufficiency": 0.5},
    "rectified": {"rows": rows_off(0.06)},
    "not_turned": {"rows": rows_off(0.0, roll_deg=0.6)},
    "coplanar": {"inner_line_height": HeightOverLane(0.1, 0.001)},
    "two_edges": {"stripes_fitted": False},
    "painted": {"borders": (StripeBorder(0.2, 0.001),)},
    "narrow_stripes": {"refined": replace(GOOD.refined, widths_m=np.array([0.15, 0.56]))},
    "stripes_in_plane": {"borders": (StripeBorder(0.0, 0.002, edge_step=EdgeStep(0.025, 0.001)),)},
    "level_stripes": {"borders": (StripeBorder(0.0, 0.002, edge_step=EdgeStep(0.1, 0.001)),)},
    "certain": {"std": np.array([0.2, 1e-4, 1e-3])},
    "lines_on_lane_surface": {"lane_heights": over(0.1, 0.0, std_m=0.005)},
    "halves_agree": {"texture": replace(ASPHALT, halves=((np.array([0.1, 0.0, 0.0]), np.full(3, 1e-4)),))},
    "no_kerb_beside": {"kerb_heights": (HeightOverLane(0.05, 0.006),)},
    "strip_agrees": {"own_strip": replace(ASPHALT, extrinsics=replace(POSE, height_m=1.54))},
    "dense_agrees": {"coarse": replace(DENSE, extrinsics=replace(POSE, height_m=1.6))},
    "faint_texture_agrees": {"sweeps": (swept((1.6, 0.0, 9.0)),)},
    "surface_agrees": {
        "contradictors": (Contradictor(replace(POSE, height_m=1.6), np.diag([0.004, 2e-4, 1.5e-3]) ** 2),)
    },
    # Each of them is four fifths of what it needs to refuse the lines alone.
    "nothing_excludes_lines": {
        "sweeps": (swept((1.6, 0.0, 4.0)),),
        "contradictors": (Contradictor(replace(POSE, height_m=1.448), np.diag([0.004, 2e-4, 1.5e-3]) ** 2),),
    },
    "parallel_cameras": {"yaw": YawTold(math.radians(-0.2), math.radians(0.01))},
    "lines_on_surface": {"surface_heights": over(0.1, 0.0)},
    "synchronised": {"lateness": Lateness(-0.2, 0.02, clear=True)},
}


@pytest.mark.parametrize("gate", GATES, ids=lambda gate: gate.key)
def test_every_gate_refuses_with_the_words_of_its_bound(gate):
    """Nobody has to guess from a value and its limit which side of it is good."""
    readings, rejection = evaluate_gates(replace(GOOD, **BAD[gate.key]))
    reading = readings[-1]
    assert (reading.name, reading.passed) == (gate.key, False)
    assert (rejection.reason, rejection.remedy) == (gate.reason, gate.remedy)
    assert (reading.value, reading.bound, reading.threshold) == (
        rejection.value,
        rejection.bound,
        rejection.threshold,
    )
    assert not is_good(reading) or gate.key == "plausible"  # there the limit itself is bad
    assert_says_everything(rejection)


def test_gates_without_evidence_are_not_read_and_those_of_before_not_again():
    early = replace(
        GOOD, bends=None, lines=None, refined=None, clipped=None, texture=None, surface_heights=()
    )
    early = replace(early, rows=None, below=None, texture_sufficiency=None, lane_heights=())
    first, _ = evaluate_gates(
        replace(
            early,
            borders=(),
            stripes_fitted=None,
            inner_line_height=None,
            std=None,
            wide_profile=None,
            coarse=None,
            sweeps=(),
            contradictors=(),
            kerb_heights=(),
            yaw=None,
            lateness=None,
        )
    )
    assert [reading.name for reading in first] == ["plausible", "fitness"]
    # The fitness is bad by now, and was good when it was read.
    both, rejection = evaluate_gates(replace(GOOD, fitness=0.0), already=first)
    assert rejection is None
    assert both[:2] == first and len(both) == len(GATES)


def test_asphalt_alone_is_plausible_rectified_and_not_turned():
    alone = Evidence(CONFIG, texture=ASPHALT, rows=GOOD.rows)
    names = ["plausible", "rectified", "not_turned"]
    assert [reading.name for reading in evaluate_gates(alone)[0]] == names
    alone = replace(alone, own_strip=ASPHALT, kerb_heights=GOOD.kerb_heights, std=GOOD.std)
    assert [reading.name for reading in evaluate_gates(alone)[0]] == [
        *names,
        "halves_agree",
        "no_kerb_beside",
        "strip_agrees",
        "certain",
    ]
    outside = replace(ASPHALT, extrinsics=moved(0, 2.5))
    assert evaluate_gates(replace(alone, texture=outside))[1].reason is RejectReason.SEARCH_SPACE_EDGE


def test_the_first_closed_gate_ends_it():
    readings, rejection = evaluate_gates(replace(GOOD, bends=Bends(0.01, 1e-6, 0.0, 1e-6), clipped=1.0))
    assert rejection.reason is RejectReason.LINES_NOT_STRAIGHT
    assert [reading.passed for reading in readings] == [True, True, False]


BOX = CONFIG.search
EDGES = [
    (0, BOX.height_min_m, 3.7, "height", 1.0),
    (0, BOX.height_max_m, -3.7, "height", 1.0),
    (1, -BOX.pitch_max_rad, math.radians(40), "pitch", DEG),
    (1, BOX.pitch_max_rad, -math.radians(40), "pitch", DEG),
    (2, -BOX.roll_max_rad, math.radians(30), "roll", DEG),
    (2, BOX.roll_max_rad, -math.radians(30), "roll", DEG),
]


@pytest.mark.parametrize(("axis", "edge", "inwards", "name", "readable"), EDGES)
def test_edge_of_the_search_space(axis, edge, inwards, name, readable):
    """A thousandth of the box counts as its edge."""

    def at(part):
        pose = np.array([1.4, 0.05, 0.01])
        pose[axis] = edge + part * inwards
        early = Evidence(CONFIG, Extrinsics.from_array(pose), 9000.0, 0.01)
        return pose[axis], evaluate_gates(early)[1]

    value, rejection = at(0.0009)
    end = "least" if inwards > 0 else "greatest"
    words = f"best {name}, ", f"{end} {name} searched is", "widen search.*"
    assert_refuses(rejection, RejectReason.SEARCH_SPACE_EDGE, value * readable, edge * readable, *words)
    assert at(0.0011)[1] is None


def test_fitness_is_compared_with_that_of_the_greatest_misfit():
    config = CalibratorConfig.from_mapping({"fitness.max_misfit_px": 2.0})
    threshold = 1 / (4.0 + 1e-4)
    assert refusal(config=config, fitness=threshold) is None
    rejection = refusal(config=config, fitness=0.999 * threshold, misfit_px=2.001)
    words = "miss every road plane by 2.00 px", "at most 2 px", "may not be parallel"
    assert_refuses(rejection, RejectReason.FITNESS_TOO_LOW, 0.999 * threshold, threshold, *words)


@pytest.mark.parametrize(("sign", "side"), [(1, "left"), (-1, "right")])
def test_bend_tighter_than_a_thousand_metres(sign, side):
    assert refusal(bends=replace(STRAIGHT, lateral_per_m=sign / 1001)) is None
    rejection = refusal(bends=replace(STRAIGHT, lateral_per_m=sign / 999))
    words = f"bend to the {side} with a radius of 999 m", "at least 1000 m", "on a straight road"
    assert_refuses(rejection, RejectReason.LINES_NOT_STRAIGHT, 999, 1000, *words)


def test_bend_that_noise_may_have_made_is_let_pass():
    """Four standard deviations: 1 / 500 with 1 / 1990 passes, with 1 / 2010 it does not."""
    assert refusal(bends=Bends(1 / 500, 1 / 1990, 0.0, 1e-6)) is None
    assert refusal(bends=Bends(1 / 500, 1 / 2010, 0.0, 1e-6)) is not None


@pytest.mark.parametrize(("sign", "kind"), [(1, "dip"), (-1, "crest")])
def test_crest_and_dip(sign, kind):
    assert refusal(bends=replace(STRAIGHT, vertical_per_m=sign / 1801)) is None
    rejection = refusal(bends=replace(STRAIGHT, vertical_per_m=sign / 1799))
    words = f"over a {kind} with a radius of 1799 m", "where the slope does not change"
    assert_refuses(rejection, RejectReason.ROAD_NOT_FLAT, 1799, 1800, *words)


def test_undetermined_pose():
    assert_refuses(refusal(lines=None), RejectReason.LINES_NOT_MATCHED, 1, 2, "undetermined")


def test_cameras_that_contradict_each_other():
    """Seven standard deviations of two numbers: a chi2 of 98."""
    assert refusal(lines=replace(LINES, chi2=97.0)) is None
    rejection = refusal(lines=replace(LINES, chi2=99.0))
    words = "contradict each other", "images are rectified"
    assert_refuses(rejection, RejectReason.LINES_INCONSISTENT, 49.5**0.5, 7, *words)


@pytest.mark.parametrize(
    ("axis", "limit", "scale"),
    [(0, 0.030, MM), (1, math.radians(0.25), DEG), (2, math.radians(0.8), DEG)],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_refinement_stays_near_the_lines(axis, limit, scale, sign):
    without = {"texture": None, "surface_heights": (), "rows": None, "coarse": None, "sweeps": ()}
    near, far = (replace(REFINED, extrinsics=moved(axis, sign * part * limit)) for part in (0.99, 1.01))
    assert refusal(refined=near, **without) is None
    rejection = refusal(refined=far, **without)
    assert_refuses(
        rejection, RejectReason.STAGES_DISAGREE, 1.01 * limit * scale, limit * scale, "grey values"
    )
    # In noise the lines are less sure, and so is what they ask of the refinement.
    noisy = replace(LINES, covariance=np.eye(3) * (0.11 * limit) ** 2)
    assert refusal(refined=far, lines=noisy, **without) is None


def test_lines_of_one_road_are_as_wide_and_as_far_apart_as_lines_are():
    """With the cameras exchanged, the next line may be taken for the same one, on a road far too small."""
    assert refusal(refined=replace(REFINED, widths_m=np.array([0.051, 0.2]))) is None
    rejection = refusal(refined=replace(REFINED, widths_m=np.array([0.2, 0.049])))
    assert_refuses(rejection, RejectReason.LINES_NOT_MATCHED, 0.049, 0.05, "narrow", "swapped")
    assert refusal(refined=replace(REFINED, positions_m=np.array([0.26, -1.0]))) is None
    rejection = refusal(refined=replace(REFINED, positions_m=np.array([0.24, -1.0])))
    assert_refuses(rejection, RejectReason.LINES_NOT_MATCHED, 1.24, 1.25, "near to each other", "swapped")


def test_blur():
    """A fit that ends at its greatest blur, 3 px, has not found it."""
    assert refusal(refined=replace(REFINED, blur_px=np.array([0.5, 2.9]))) is None
    rejection = refusal(refined=replace(REFINED, blur_px=np.array([2.95, 0.5])))
    assert_refuses(rejection, RejectReason.IMAGE_BLURRED, 2.95, 2.91, "blur", "focus")


def test_exposure():
    assert refusal(clipped=0.5) is None
    assert_refuses(refusal(clipped=0.51), RejectReason.IMAGE_EXPOSURE, 0.51, 0.5, "black or white")


def test_witness():
    assert refusal(texture_sufficiency=1.0) is None
    assert refusal(texture_sufficiency=None) is None  # not required
    assert_refuses(
        refusal(texture_sufficiency=0.99),
        RejectReason.ROAD_WITHOUT_TEXTURE,
        0.99,
        1.0,
        "road surface",
        "lines alone",
    )


@pytest.mark.parametrize("changes", [{"sigmas": 4.0}, {"cell_share": 0.2}, {"noise_std": (0.02, 1e-4, 1e-4)}])
def test_half_the_texture_is_a_witness_of_half(changes):
    assert ASPHALT.sufficiency >= 1.0
    poor = replace(ASPHALT, quality=replace(ASPHALT.quality, **changes))
    assert poor.sufficiency == pytest.approx(0.5)
    assert not poor.enough_texture


def test_an_uneven_road_is_no_witness_either():
    uneven = replace(ASPHALT, terms=(UncertaintyTerm("noise", np.diag([0.06, 1e-4, 1e-4]) ** 2),))
    assert uneven.sufficiency == pytest.approx(0.5)
    assert uneven.enough_texture


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rectification(sign):
    def off(degrees, std_deg=0.002):
        return refusal(rows=rows_off(sign * degrees, std_deg))

    assert off(0.039) is None
    words = "rows of the right image are off", "the same row"
    assert_refuses(off(0.041), RejectReason.IMAGES_NOT_RECTIFIED, 0.041, 0.04, *words)
    assert off(0.08, std_deg=0.03) is None  # may be chance


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_turned_camera(sign):
    def turned(degrees, std=0.01):
        return refusal(rows=rows_off(0.0, roll_deg=sign * degrees, roll_std_deg=std))

    assert turned(0.099) is None
    assert_refuses(turned(0.101), RejectReason.IMAGES_NOT_RECTIFIED, 0.101, 0.1, "one camera is turned")
    assert turned(0.2, std=0.08) is None


def test_a_line_below_the_plane_of_the_lines():
    assert refusal(below=BelowPlane(0.0299)) is None
    assert refusal(below=BelowPlane(0.0449, 0.015)) is None
    assert refusal(below=BelowPlane(0.0451, 0.015)) is not None
    rejection = refusal(below=BelowPlane(0.0301))
    assert_refuses(rejection, RejectReason.LINE_BELOW_ROAD, 30.1, 30.0, "below the plane", "kerb or a rail")


# What is called wrong.
WRONG = [(0, 0.060, MM), (1, math.radians(0.5), DEG), (2, math.radians(1.2), DEG)]


def only(axis, value, others):
    """Return (3,) with a value on one axis."""
    return np.where(np.arange(3) == axis, value, others)


@pytest.mark.parametrize(("axis", "limit", "scale"), WRONG)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_lines_and_asphalt_agree_within_the_tolerance(axis, limit, scale, sign):
    def off(by, std=0.001 * limit):
        seen = Contradictor(moved(axis, sign * by), np.diag(only(axis, std, [0.004, 2e-4, 1.5e-3])) ** 2)
        alike = GOOD.contradictors
        return [refusal(contradictors=order) for order in ((seen, *alike), (*alike, seen))]

    assert off(0.99 * limit) == [None, None]
    for rejection in off(1.01 * limit):
        limits = 1.01 * limit * scale, limit * scale
        assert_refuses(rejection, RejectReason.TEXTURE_DISAGREES, *limits, "kerb")
    # A less certain one excludes what is as unlikely as five standard deviations: chi squared of 31.8.
    excluded = math.sqrt(31.8) * 0.25
    assert off(0.99 * excluded * limit, 0.25 * limit) == [None, None]
    assert None not in off(1.01 * excluded * limit, 0.25 * limit)


def test_all_three_numbers_together_exclude_lines():
    """None of them alone does, by its own deviation: height and pitch go together in what is known."""
    std = np.array([0.02, math.radians(0.2), math.radians(0.4)])
    correlated = np.outer(std, std) * [[1.0, 0.95, 0.0], [0.95, 1.0, 0.0], [0.0, 0.0, 1.0]]
    for sign, excluded in ((1.0, False), (-1.0, True)):
        pose = Extrinsics.from_array(POSE.as_array() + np.array([0.065, sign * math.radians(0.4), 0.0]))
        rejection = refusal(contradictors=(Contradictor(pose, correlated),))
        assert (rejection is not None) == excluded


@pytest.mark.parametrize(("sign", "side"), [(1.0, "left"), (-1.0, "right")])
def test_cameras_that_are_not_parallel(sign, side):
    """By what makes a pose over the surface wrong."""

    def turned(degrees):
        return refusal(yaw=YawTold(math.radians(sign * degrees), math.radians(0.02)))

    assert turned(0.049) is None
    words = f"right camera looks 0.051 deg farther to the {side}", "std 0.020 deg"
    assert_refuses(turned(0.051), RejectReason.IMAGES_NOT_RECTIFIED, 0.051, 0.05, *words)
    assert refusal(yaw=None) is None


@pytest.mark.parametrize(("sign", "late"), [(1.0, "left"), (-1.0, "right")])
def test_images_that_are_not_of_one_moment(sign, late):
    """Against the way that makes a height wrong; 0.139 m at 50 km/h are 10 ms."""

    def moved_by(way_m):
        return refusal(lateness=Lateness(sign * way_m, 0.02, clear=True))

    assert moved_by(0.099) is None
    words = f"the {late} image was taken", "at 50 km/h", "trigger both cameras together"
    assert_refuses(moved_by(0.139), RejectReason.IMAGES_NOT_SYNCHRONISED, 0.139, 0.1, *words, "10 ms")
    assert refusal(lateness=None) is None


@pytest.mark.parametrize(("axis", "limit", "scale"), WRONG)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_dense_disparities_exclude_what_is_wrong(axis, limit, scale, sign):
    """By five standard deviations of both, where these are more than what is called wrong."""

    def off(by, std):
        coarse = CoarseRoad(moved(axis, sign * by), np.diag(only(axis, std, 1e-4)) ** 2, 0.8, 0.9, 2)
        return refusal(coarse=coarse, std=only(axis, 0.2 * limit, GOOD.std), sweeps=())

    assert off(1.09 * limit, 0.1 * limit) is None
    of_both = 5.0 * math.hypot(0.1, 0.2)
    rejection = off(1.01 * of_both * limit, 0.1 * limit)
    words = "dense disparities of the road", "kerb"
    limits = 1.01 * of_both * limit * scale, of_both * limit * scale
    assert_refuses(rejection, RejectReason.TEXTURE_DISAGREES, *limits, *words)
    assert off(1.2 * of_both * limit, 0.2 * limit) is None
    assert refusal(coarse=None) is None


@pytest.mark.parametrize(("axis", "limit", "scale"), WRONG)
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("place", [0, 1])
def test_halves_of_the_surface_agree(axis, limit, scale, sign, place):
    """Either of near against far and left against right counts, where the surface is all that is known."""

    def off(by, std=1e-4, **changes):
        halves = [(np.zeros(3), np.full(3, 1e-4)), (np.zeros(3), np.full(3, 1e-4))]
        halves[place] = (only(axis, sign * by, 0.0), only(axis, std, 1e-4))
        return refusal(texture=replace(ASPHALT, halves=tuple(halves)), **changes)

    assert off(0.99 * limit) is None
    limits = 1.01 * limit * scale, limit * scale
    words = "two halves of the road surface differ", "one plane"
    assert_refuses(off(1.01 * limit), RejectReason.ROAD_NOT_FLAT, *limits, *words)
    assert off(1.24 * limit, 0.25 * limit) is None
    assert off(1.26 * limit, 0.25 * limit) is not None
    assert off(1.26 * limit, kerb_heights=()) is None  # with lines, the profile along them tells


@pytest.mark.parametrize(("height_m", "roll_rad"), [(0.07, 0.0), (-0.07, 0.0), (0.0, 0.03), (0.0, -0.03)])
def test_the_faintest_texture_excludes_lines_by_five_deviations(height_m, roll_rad):
    """Those of a plane that is wrong if theirs is right."""
    at = POSE.height_m + height_m, POSE.roll_rad + roll_rad
    here = POSE.height_m, POSE.roll_rad
    assert refusal(sweeps=(swept((*at, 4.9)),)) is None
    rejection = refusal(sweeps=(swept((*at, 5.1)),))
    words = f"the surface between the lane lines is a plane {at[0]:.3f} m below", "kerb"
    assert_refuses(rejection, RejectReason.TEXTURE_DISAGREES, 5.1, 5.0, *words)
    # Both images agree under the plane of the lines, too: by half as well, the other may be a pattern.
    assert refusal(sweeps=(swept((*at, 9.0), (*here, 4.4)),)).value == pytest.approx(math.sqrt(81.0 - 4.4**2))
    assert refusal(sweeps=(swept((*at, 9.0), (*here, 4.6)),)) is None
    # A plane that is not wrong contradicts nothing.
    assert (
        refusal(sweeps=(swept((POSE.height_m + height_m / 2.0, POSE.roll_rad + roll_rad / 2.0, 9.0)),))
        is None
    )
    assert refusal(sweeps=()) is None


@pytest.mark.parametrize(
    ("axis", "limit", "scale"),
    [(0, 0.030, MM), (1, math.radians(0.25), DEG), (2, math.radians(0.8), DEG)],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_strip_under_the_car_agrees_with_all_of_the_surface(axis, limit, scale, sign):
    """Within what tells one road from another, or five standard deviations of the strip."""

    def off(by, std=1e-4):
        terms = (UncertaintyTerm("noise", np.diag(only(axis, std, 1e-4)) ** 2),)
        return refusal(own_strip=replace(ASPHALT, extrinsics=moved(axis, sign * by), terms=terms))

    assert off(0.99 * limit) is None
    words = "the strip under the car", "pavement or of another lane"
    limits = 1.01 * limit * scale, limit * scale
    assert_refuses(off(1.01 * limit), RejectReason.TEXTURE_DISAGREES, *limits, *words)
    assert off(1.24 * limit, 0.25 * limit) is None
    assert off(1.26 * limit, 0.25 * limit) is not None


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_lines_lie_in_the_asphalt(sign):
    """Either line counts, above or below, wherever its lever leads the pose."""
    assert refusal(surface_heights=over(0.0, sign * 0.0299)) is None
    rejection = refusal(surface_heights=over(sign * 0.0301, 0.0))
    words = "a lane line and the road surface beside it differ in height", "kerb"
    assert_refuses(rejection, RejectReason.TEXTURE_DISAGREES, 30.1, 30.0, *words)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("std_m", "limit_m"), [(0.005, 0.03), (0.02, 0.06)])
def test_lines_lie_in_the_asphalt_between_them(sign, std_m, limit_m):
    """Half of the lowest kerb, or three standard deviations."""
    assert refusal(lane_heights=over(0.0, sign * 0.99 * limit_m, std_m=std_m)) is None
    rejection = refusal(lane_heights=over(sign * 1.01 * limit_m, 0.0, std_m=std_m))
    words = "without what is beyond", "road surface between the lines", "kerb"
    assert_refuses(rejection, RejectReason.TEXTURE_DISAGREES, 1010.0 * limit_m, 1e3 * limit_m, *words)


@pytest.mark.parametrize(
    ("change", "what", "value", "threshold"),
    [((0.031, 0.0), "height", 31.0, 30.0), ((0.0, math.radians(-0.26)), "pitch", 0.26, 0.25)],
)
def test_near_and_far_parts_of_the_road_are_one_plane(change, what, value, threshold):
    def with_profile(change, std=(1e-3, 1e-4)):
        return replace(FLAT, change=np.array(change), covariance=np.diag(std) ** 2)

    rejection = refusal(wide_profile=with_profile(change))
    assert_refuses(rejection, RejectReason.ROAD_NOT_FLAT, value, threshold, what)
    assert refusal(wide_profile=with_profile(0.95 * np.array(change))) is None
    # What noise may have done does not count.
    assert refusal(wide_profile=with_profile(change, (0.0078, math.radians(0.066)))) is None


def test_between_a_stripe_and_its_lane_there_is_nothing():
    known = EdgeStep(0.0, 0.02)
    assert_refuses(
        refusal(borders=(StripeBorder(0.0, 0.001), StripeBorder(-0.07, 0.001, edge_step=known))),
        RejectReason.LINE_NOT_PAINTED,
        0.07,
        0.06,
        "kerb",
    )
    assert refusal(borders=(StripeBorder(0.0, 0.001), StripeBorder(0.055, 0.001, edge_step=known))) is None
    assert refusal(borders=(StripeBorder(0.07, 0.018, edge_step=known),)) is None
    rejection = refusal(borders=(StripeBorder(0.0, 0.001, 0.07, 0.001),))
    assert_refuses(rejection, RejectReason.LINE_NOT_PAINTED, 0.07, 0.06, "within a stripe")
    assert refusal(borders=(StripeBorder(0.0, 0.001, 0.07, 0.018),)) is None


def test_the_strip_beside_a_stripe_is_bare_where_its_edges_show_nothing():
    """Neither says then that it is paint: the upper half of a rail, 143 mm and 4.8 deg off."""
    rejection = refusal(borders=(StripeBorder(-0.011, 0.001), StripeBorder(0.0, 0.001)))
    assert_refuses(rejection, RejectReason.LINE_NOT_PAINTED, 0.011, 0.01, "between a stripe and the lane")
    assert refusal(borders=(StripeBorder(-0.009, 0.001), StripeBorder(0.0, 0.001))) is None
    assert refusal(borders=(StripeBorder(-0.011, 0.003), StripeBorder(0.0, 0.001))) is None


def test_a_narrow_face_beside_a_stripe_has_a_limit_of_its_own():
    def of_face(face, std=0.001):
        return refusal(borders=(StripeBorder(0.0, 0.001, 0.0, 0.001, face, std), StripeBorder(0.0, 0.001)))

    assert_refuses(of_face(0.11), RejectReason.LINE_NOT_PAINTED, 0.11, 0.1, "between a stripe and the lane")
    assert of_face(0.09) is None
    assert of_face(0.11, 0.028) is None


def test_a_shadow_may_end_within_a_stripe_that_is_level():
    """One edge may be lower than the other by half the lowest kerb, less two deviations to be sure."""
    shaded = StripeBorder(0.0, 0.002, half_difference=0.3, half_difference_std=0.002)
    assert refusal(borders=(replace(shaded, edge_step=EdgeStep(0.019, 0.005)),)) is None
    for unsure in (EdgeStep(0.021, 0.005), EdgeStep(0.0, 0.016), EdgeStep()):
        rejection = refusal(borders=(replace(shaded, edge_step=unsure),))
        assert_refuses(rejection, RejectReason.LINE_NOT_PAINTED, 0.3, 0.06, "within a stripe")


def test_no_shadow_ends_where_the_asphalt_is_alike_on_both_sides():
    def of_level(unshaded_difference, std=0.002):
        level = EdgeStep(0.0, 0.002)
        return refusal(
            borders=(
                StripeBorder(
                    0.0,
                    0.002,
                    half_difference=0.5,
                    half_difference_std=std,
                    unshaded_difference=unshaded_difference,
                    edge_step=level,
                ),
            )
        )

    assert_refuses(of_level(-0.21), RejectReason.LINE_NOT_PAINTED, 0.21, 0.2, "within a stripe")
    assert of_level(0.19) is None
    assert of_level(-0.21, 0.055) is None


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("std_m", "limit_m"), [(0.001, 0.03), (0.01, 0.04)])
def test_both_edges_of_a_stripe_lie_in_the_road(sign, std_m, limit_m):
    good, bad = (
        StripeBorder(0.0, 0.002, edge_step=EdgeStep(sign * part * limit_m, std_m)) for part in (0.99, 1.01)
    )
    assert refusal(borders=(good,), refined=None) is None
    rejection = refusal(borders=(StripeBorder(0.0, 0.002), bad), refined=None)
    assert_refuses(rejection, RejectReason.LINE_NOT_PAINTED, 1010 * limit_m, 1e3 * limit_m, "kerb")


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_paint_lies_in_the_plane_of_both_lines(sign):
    """Up to a cross fall of 5 %, and four standard deviations."""
    width_m = float(GOOD.refined.widths_m[0])

    def tilted(part):
        step = EdgeStep(sign * (0.05 * width_m + 4.0 * 0.001 * part), 0.001)
        return refusal(borders=(StripeBorder(0.0, 0.002, edge_step=step),))

    assert tilted(0.99) is None
    assert tilted(1.01).reason is RejectReason.LINE_NOT_PAINTED


def test_lines_alone_show_both_edges():
    assert_refuses(refusal(stripes_fitted=False), RejectReason.LINE_NOT_PAINTED, 0, 2, "both edges")


@pytest.mark.parametrize("height_m", [0.031, -0.031])
def test_lines_between_the_boundaries_lie_in_their_plane(height_m):
    rejection = refusal(inner_line_height=HeightOverLane(height_m, 0.001))
    assert_refuses(rejection, RejectReason.LINES_NOT_COPLANAR, 31.0, 30.0, "mm")
    assert refusal(inner_line_height=HeightOverLane(0.95 * height_m, 0.001)) is None
    assert refusal(inner_line_height=HeightOverLane(height_m, 0.008)) is None


@pytest.mark.parametrize(("axis", "limit", "scale"), WRONG)
def test_an_estimate_as_uncertain_as_what_is_wrong_is_none(axis, limit, scale):
    std = np.array([0.003, 1e-4, 1e-3])
    assert refusal(std=only(axis, 0.99 * limit, std)) is None
    rejection = refusal(std=only(axis, 1.01 * limit, std))
    assert rejection.reason is RejectReason.ESTIMATE_UNCERTAIN
    assert (rejection.value, rejection.unit) == (
        pytest.approx(1.01 * limit * scale),
        "mm" if axis == 0 else "deg",
    )
