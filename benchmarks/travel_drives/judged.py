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

"""Drives through the calibrator, frame by frame, and what their direction of travel was worth."""

from __future__ import annotations

import csv
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from stereo_selfcal import Calibrator

from ..options import RESULTS, Options
from ..revision import estimator_revision
from ..table import NothingToMeasureError, Table, number
from .kinds import ONLY_BENDS, Course, Drive, Plan, drive, plans

# The file to which single drives are added as they are judged.
EACH = RESULTS / "travel_drives_each.csv"
_PARTS_S = (10.0, 20.0, 30.0)  # after which estimates are noted, besides at the end
_SMALL_DRIVES = 34  # twice each course
_RATIO = (0.75, 1.3)  # of errors to standard deviations (issue 22)
_STRAIGHT_STD_DEG = 0.1  # at most, after 30 s of straight road (issue 22)
_BENDS_STD_DEG = 0.3  # not below, of bends alone (issue 22)
_FAR = 3.0
# What is known of any mount (design of issue 22): a yaw that is less certain tells nothing.
_TELLS_DEG = 1.0


@dataclass(frozen=True, slots=True)
class Verdict:
    """What was known of a drive after some time.

    Attributes:
        revision: Commit of what was judged.
        seed: Seed of the series.
        index: Number of the drive in it.
        course: What was driven.
        mode: "small" images, or "full" ones of the rig's size.
        rig: Name of the rig.
        surroundings: What the street runs through.
        hour: The light.
        drive_s: Duration of the whole drive.
        after_s: When the estimate was noted.
        last: Whether that was the end of the drive.
        frames: Frames so far.
        accepted: Of these, how many were accepted.
        n_steps: Of the estimate; 0: there was none.
        yaw_deg: Truth.
        pitch_deg: Truth.
        yaw_error_deg: Of the estimate; NaN: there was none.
        yaw_std_deg: What it says of itself.
        pitch_error_deg: Of the estimate.
        pitch_std_deg: What it says of itself.
        speed_mps: How fast it was driven.
        rate_hz: Frames per second.
        fall: How the road falls to the right.
        wind_mps: Wind from the right.
        lever_m: Camera ahead of the rear axle.
        crab_deg: By how much the car crabs at the usual fall.
        mean_turn_deg_s: Mean turn rate.
        rms_turn_deg_s: Root mean square of the turn rate.
    """

    revision: str
    seed: int
    index: int
    course: str
    mode: str
    rig: str
    surroundings: str
    hour: str
    drive_s: float
    after_s: float
    last: int
    frames: int
    accepted: int
    n_steps: int
    yaw_deg: float
    pitch_deg: float
    yaw_error_deg: float
    yaw_std_deg: float
    pitch_error_deg: float
    pitch_std_deg: float
    speed_mps: float
    rate_hz: float
    fall: float
    wind_mps: float
    lever_m: float
    crab_deg: float
    mean_turn_deg_s: float
    rms_turn_deg_s: float

    @property
    def known(self) -> bool:
        """Whether there was an estimate."""
        return not math.isnan(self.yaw_error_deg)

    @property
    def tells_yaw(self) -> bool:
        """Whether it tells more of the yaw than is known of any mount."""
        return self.known and self.yaw_std_deg < _TELLS_DEG


def judge(plan: Plan, revision: str) -> list[Verdict]:
    """Film a drive, calibrate from all of its frames, and return its verdicts in order of time."""
    driven = drive(plan)
    calibrator = Calibrator(driven.film.rig)
    verdicts, accepted = [], 0
    for count, time_s in enumerate(driven.times_s.tolist(), 1):
        result = calibrator.add(*driven.film.pair(time_s), 1000.0 + time_s)
        accepted += bool(result.accepted)
        last = count == len(driven.times_s)
        following = math.inf if last else float(driven.times_s[count])
        if last or any(time_s < part <= following for part in _PARTS_S):
            after = plan.duration_s if last else next(part for part in _PARTS_S if part > time_s)
            verdicts.append(_verdict(driven, revision, calibrator, after, last, count, accepted))
    return verdicts


def _verdict(
    driven: Drive,
    revision: str,
    calibrator: Calibrator,
    after_s: float,
    last: bool,
    frames: int,
    accepted: int,
) -> Verdict:
    plan, travel = driven.plan, calibrator.estimate.travel
    truth = np.degrees([driven.yaw_rad, driven.pitch_rad])
    error = std = np.full(2, np.nan)
    if travel is not None:
        error = np.degrees([travel.yaw_rad, travel.pitch_rad]) - truth
        std = np.degrees(np.sqrt(np.diag(travel.covariance)))
    return Verdict(
        revision,
        plan.seed,
        plan.index,
        plan.course.value,
        "full" if plan.scale == 1.0 else "small",
        plan.rig,
        plan.surroundings.value,
        plan.hour.value,
        plan.duration_s,
        after_s,
        int(last),
        frames,
        accepted,
        0 if travel is None else travel.n_steps,
        *(round(float(value), 5) for value in (*truth, error[0], std[0], error[1], std[1])),
        **{name: round(value, 4) for name, value in driven.labels.items()},
    )


def run(
    wanted: list[Plan], path: Path, revision: str, say: Callable[[str], object], budget_s: float = math.inf
) -> None:
    """Judge drives one after the other, and add each to a file as soon as it is judged.

    Args:
        wanted: The drives.
        path: The file; drives that are in it, of this revision, are not judged again.
        revision: Commit of what is judged.
        say: Told what came of each.
        budget_s: No drive is begun after so long.
    """
    done = {(each.revision, each.seed, each.index, each.mode) for each in read(path)}
    begin = time.monotonic()
    for plan in wanted:
        key = (revision, plan.seed, plan.index, "full" if plan.scale == 1.0 else "small")
        if key in done:
            continue
        if time.monotonic() - begin > budget_s:
            break
        verdicts = judge(plan, revision)
        new = not path.exists()
        with path.open("a", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, [each.name for each in fields(Verdict)], lineterminator="\n")
            if new:
                writer.writeheader()
            writer.writerows(asdict(each) for each in verdicts)
        end = verdicts[-1]
        say(
            f"{plan.seed}/{plan.index} {plan.name} {plan.rig} {plan.surroundings.value} {plan.hour.value}: "
            f"yaw {end.yaw_error_deg:+.3f} ({end.yaw_std_deg:.3f}), pitch {end.pitch_error_deg:+.3f} "
            f"({end.pitch_std_deg:.3f}), {end.n_steps} steps of {end.frames}, "
            f"{time.monotonic() - begin:.0f} s"
        )


def read(path: Path) -> list[Verdict]:
    """Return the verdicts of a file; none where there is no file."""
    if not path.exists():
        return []
    kinds = {each.name: each.type for each in fields(Verdict)}
    convert = {"int": int, "float": float, "str": str}
    with path.open(newline="", encoding="utf-8") as file:
        return [
            Verdict(**{name: convert[str(kinds[name])](value) for name, value in row.items()})
            for row in csv.DictReader(file)
        ]


def drive_tables(options: Options) -> Iterator[Table]:
    """Judge the drives of a series that are not in the file yet, and say what all in the file are worth."""
    small = plans(options.seed, 0, min(options.drives, _SMALL_DRIVES), small=True)
    revision = estimator_revision()
    run(small, EACH, revision, lambda text: None)
    yield from tables(read(EACH))


def tables(verdicts: list[Verdict]) -> Iterator[Table]:
    """Yield what verdicts say: by course, and what is demanded of them.

    Raises:
        NothingToMeasureError: There are none.
    """
    if not verdicts:
        raise NothingToMeasureError("no drive was judged")
    yield _by_course(verdicts)
    yield _checks(verdicts)


def _groups(verdicts: list[Verdict]) -> Iterator[tuple[str, list[Verdict]]]:
    ends = [each for each in verdicts if each.last]
    straight = [each for each in verdicts if each.course == Course.STRAIGHT.value]
    for after in _PARTS_S:
        yield f"straight, after {after:g} s", [each for each in straight if each.after_s == after]
    for course in Course:
        if course is not Course.STRAIGHT:
            yield course.value, [each for each in ends if each.course == course.value]
    for hour in ("night",):
        yield hour, [each for each in ends if each.hour == hour]
    for rig in sorted({each.rig for each in ends}):
        yield f"rig {rig}", [each for each in ends if each.rig == rig]
    for mode in sorted({each.mode for each in ends}):
        yield f"{mode} images", [each for each in ends if each.mode == mode]
    yield "all", ends


def _by_course(verdicts: list[Verdict]) -> Table:
    table = Table(
        "travel_drives",
        "The direction of travel by rendered drives",
        [
            "drives",
            "number",
            "with an estimate, with a yaw",
            "yaw: error over std (rms)",
            "beyond 3 std %",
            "std median",
            "std worst",
            "error rms",
            "pitch: error over std (rms)",
            "beyond 3 std %",
            "std median",
            "std worst",
            "error rms",
        ],
        f"Degrees. A yaw with a std of {_TELLS_DEG:g} deg or more tells nothing, and is not counted. "
        "Straight drives count after 10, 20 and 30 s, as far as they go; all others at their end. Each is in "
        f"{EACH.name}, with the commit that was judged.",
    )
    for name, group in _groups(verdicts):
        known = [each for each in group if each.known]
        if not group:
            continue
        told = [each for each in known if each.tells_yaw]
        cells = [*_cells(told, "yaw"), *_cells(known, "pitch")]
        table.add(name, str(len(group)), f"{len(known)}, {len(told)}", *cells)
    return table


def _column(known: list[Verdict], name: str) -> np.ndarray:
    return np.array([getattr(each, name) for each in known])


def _cells(known: list[Verdict], angle: str) -> list[str]:
    if not known:
        return ["-"] * 5
    error, std = _column(known, f"{angle}_error_deg"), _column(known, f"{angle}_std_deg")
    ratio = error / std
    values = (
        _rms(ratio),
        100.0 * float(np.mean(np.abs(ratio) > _FAR)),
        float(np.median(std)),
        float(std.max()),
        _rms(error),
    )
    return [number(value) for value in values]


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _checks(verdicts: list[Verdict]) -> Table:
    """Return what issue 22 demands, and whether it is so."""
    table = Table("travel_checks", "What is demanded of them", ["check", "measured", "demanded", "holds"])
    known = [each for each in verdicts if each.last and each.known]
    for angle, group in (("yaw", [each for each in known if each.tells_yaw]), ("pitch", known)):
        if group:
            ratio = _rms(_column(group, f"{angle}_error_deg") / _column(group, f"{angle}_std_deg"))
            table.add(
                f"{angle}: error over std (rms), all drives",
                number(ratio),
                f"{_RATIO[0]} to {_RATIO[1]}",
                _yes(_RATIO[0] <= ratio <= _RATIO[1]),
            )
    straight = [each for each in verdicts if each.course == Course.STRAIGHT.value and each.after_s == 30.0]
    if straight:
        stds = np.array([each.yaw_std_deg if each.known else np.inf for each in straight])
        good = int(np.sum(stds <= _STRAIGHT_STD_DEG))
        table.add(
            "yaw: greatest std after 30 s of straight road",
            f"{number(float(stds.max()))} (at most {_STRAIGHT_STD_DEG} in {good} of {len(stds)})",
            f"at most {_STRAIGHT_STD_DEG}",
            _yes(good == len(stds)),
        )
    courses = [course.value for course in ONLY_BENDS]
    bends = [each for each in verdicts if each.course in courses]
    if bends:
        stds = np.array([each.yaw_std_deg if each.known else np.inf for each in bends])
        bad = int(np.sum(stds < _BENDS_STD_DEG))
        table.add(
            "yaw: least std of bends alone, at any time",
            f"{number(float(stds.min()))} (below {_BENDS_STD_DEG} in {bad} of {len(stds)})",
            f"not below {_BENDS_STD_DEG}",
            _yes(bad == 0),
        )
    return table


def _yes(holds: bool) -> str:
    return "yes" if holds else "no"
