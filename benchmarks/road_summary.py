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

"""What is asked of real and rendered roads, beside what was measured."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from stereo_selfcal.core.rejection import RejectReason

from .frames import Array
from .road_pairs import SEQUENCE_MEAN, STRAIGHT
from .road_verdicts import RoadVerdict, rms_of, robust_std_of
from .table import Table, numbers
from .worlds import GROSS

# Asked of the frames with lidar: the share accepted, error over standard deviation, and the median errors of
# the straight ones in mm, deg, deg.
LEAST_ACCEPTED_FRAMES = 38 / 42
RATIO = (0.7, 1.3)
STRAIGHT_MEDIAN = np.array([6.0, 0.035, 0.12])
# Asked of the sequence: share accepted, and the mean of height and pitch.
LEAST_ACCEPTED_SEQUENCE = 45 / 51
MEAN_OFF = np.array([20.0, 0.15])
# Asked of the two roads that have to be accepted.
ROAD_STD = np.array([25.0, 0.2, 0.5])
LEAST_GOOD_WORLDS = 5 / 9
# Of the five with a turned camera, as many were accepted and wrong before.
MOST_TURNED_WRONG = 5
LEAST_OF_PEER = 0.9

Verdicts = Sequence[RoadVerdict]
# What is asked, what was measured, and whether that is enough.
Row = tuple[str, str, str, bool]


def summary_table(of_source: dict[str, list[RoadVerdict]]) -> Table:
    """Return the table of what is asked and what was measured."""
    table = Table(
        "roads",
        "Real and rendered roads of others: asked and measured",
        ["set", "what", "asked", "measured", "met"],
        "mm, deg, deg where there are three. The words are explained below. Each set is listed pair by pair.",
    )
    asked = {
        "kitti_frames": _frames,
        "kitti_odometry02": _drive,
        "kitti_odometry07": _sequence,
        "roads": _roads,
        "worlds": _worlds,
    }
    for source, verdicts in of_source.items():
        for what, limit, measured, met in asked[source](verdicts):
            table.add(source, what, limit, measured, "-" if limit == "-" else "yes" if met else "**no**")
    return table


def _frames(verdicts: Verdicts) -> Iterator[Row]:
    accepted = [each for each in verdicts if each.accepted]
    least = f"at least {LEAST_ACCEPTED_FRAMES:.0%}"
    yield _share("accepted, all kinds", least, accepted, verdicts, LEAST_ACCEPTED_FRAMES)
    yield _none("gross", [each for each in verdicts if each.gross])
    yield _none("wrong", [each for each in verdicts if each.wrong])
    if accepted:
        sigmas = np.array([each.sigmas for each in accepted])
        for name, ratio in (("RMS", rms_of(sigmas)), ("robust", robust_std_of(sigmas))):
            met = bool(np.all((ratio >= RATIO[0]) & (ratio <= RATIO[1])))
            yield f"error / std, {name}", numbers(RATIO, separator=" to "), numbers(ratio), met
    straight = [each for each in verdicts if each.tag == STRAIGHT]
    seen = [each for each in straight if each.accepted]
    yield _share("accepted, straight ones", "all", seen, straight, 1.0)
    if seen:
        median = np.nanmedian(np.abs([each.error for each in seen]), axis=0)
        met = bool(np.all(median <= STRAIGHT_MEDIAN))
        yield "median error, straight ones", f"at most {numbers(STRAIGHT_MEDIAN)}", numbers(median), met
    yield from _against_peer(verdicts)


def _against_peer(verdicts: Verdicts) -> Iterator[Row]:
    ours = [each.error for each in verdicts if each.accepted]
    theirs = [each.peer_error for each in verdicts if len(each.peer)]
    share = len(ours) / max(1, len(theirs))
    least = f"at least {LEAST_OF_PEER:.0%}"
    yield "answers by the peer's", least, f"{len(ours)} by {len(theirs)}: {share:.0%}", share >= LEAST_OF_PEER
    if not (ours and theirs):
        return
    yield "gross, the peer's", "-", str(sum(each.peer_gross for each in verdicts)), True
    for name, quantile in (("median", 0.5), ("90 %", 0.9)):
        mine, other = (np.nanquantile(np.abs(errors), quantile, axis=0) for errors in (ours, theirs))
        measured = (
            f"{numbers(mine)} by {numbers(other)}: {numbers(mine / np.where(other > 0, other, np.nan), 2)}"
        )
        yield f"{name} of |error| by the peer's", "below 1", measured, bool(np.all(mine < other))


def _drive(verdicts: Verdicts) -> Iterator[Row]:
    yield _share("accepted", "all", [each for each in verdicts if each.accepted], verdicts, 1.0)
    yield _none("gross", [each for each in verdicts if each.gross])


def _sequence(verdicts: Verdicts) -> Iterator[Row]:
    accepted = [each for each in verdicts if each.accepted]
    least = f"at least {LEAST_ACCEPTED_SEQUENCE:.0%}"
    yield _share("accepted", least, accepted, verdicts, LEAST_ACCEPTED_SEQUENCE)
    if not accepted:
        return
    poses, std = np.array([each.pose for each in accepted]), np.array([each.std for each in accepted])
    mean = poses.mean(axis=0)
    met = bool(np.all(np.abs(mean - SEQUENCE_MEAN)[:2] <= MEAN_OFF))
    limit = f"{numbers(SEQUENCE_MEAN[:2])} to within {numbers(MEAN_OFF)}"
    yield "mean height, pitch", limit, numbers(mean[:2], 4), met
    yield "median height, pitch, roll", "-", numbers(np.median(poses, axis=0), 4), True
    yield "mean roll (dense disparity: 0.31)", "-", numbers(mean[2:]), True
    seen = [each for each in accepted if len(each.peer)]
    if seen:
        other = np.mean([each.peer for each in seen], axis=0)
        yield "mean height, pitch, roll: the peer's, of the same frames", "-", numbers(other, 4), True
        # The car moves, and the peer sees it move: where both are far from the mount, the road is.
        apart = [each for each in seen if np.any(np.abs(each.pose - each.peer) > GROSS)]
        limit = f"ours and the peer's differ by more than {numbers(GROSS)}"
        yield limit, "-", _named(apart), True
    if len(accepted) > 1:
        typical = rms_of(std)
        yield "scatter / std, the motion of the car in it", "-", numbers(poses.std(axis=0) / typical), True
        steps: Array = rms_of(np.diff(poses, axis=0)) / np.sqrt(2.0)
        yield "scatter from one frame to the next / std", "-", numbers(steps / typical), True


def _roads(verdicts: Verdicts) -> Iterator[Row]:
    for each in verdicts:
        if each.expected == "accepted":
            yield (
                each.name,
                "right",
                each.word + (f": {each.reason}" if each.reason else ""),
                each.word == "right",
            )
            if each.accepted:
                met = bool(np.all(each.std <= ROAD_STD))
                yield f"{each.name}, std", f"at most {numbers(ROAD_STD)}", numbers(each.std), met
        elif "unrectified" in each.name:
            reason = str(RejectReason.IMAGES_NOT_RECTIFIED)
            yield each.name, reason, each.reason or each.word, each.reason == reason
    others = [each for each in verdicts if each.expected == "welcome"]
    yield "the others", "-", _counts(others), True
    yield _none("wrong or gross", [each for each in verdicts if each.wrong or each.gross])
    yield _none("off", [each for each in verdicts if each.word == "off"])
    refusals = [each for each in verdicts if each.expected == "refused" and each.accepted]
    yield "accepted, where lines alone have to refuse (no reference)", "-", _named(refusals), True


def _worlds(verdicts: Verdicts) -> Iterator[Row]:
    good, bad, turned = ([each for each in verdicts if each.tag == tag] for tag in ("good", "bad", "turned"))
    fine = [each for each in bad if not (each.wrong or each.gross)]
    yield _share("bad ones refused or right", "all", fine, bad, 1.0)
    faults = [each for each in turned if each.wrong or each.gross]
    yield (
        "a turned camera: accepted and wrong",
        f"at most {MOST_TURNED_WRONG}",
        _named(faults),
        len(faults) <= MOST_TURNED_WRONG,
    )
    accepted = [each for each in good if each.accepted]
    least = f"at least {LEAST_GOOD_WORLDS:.0%}"
    yield _share("good ones accepted", least, accepted, good, LEAST_GOOD_WORLDS)
    yield _none("good ones wrong", [each for each in good if each.wrong or each.gross])


def _share(what: str, asked: str, some: Verdicts, all_of_them: Verdicts, least: float) -> Row:
    met = bool(all_of_them) and len(some) >= least * len(all_of_them) - 1e-9
    return what, asked, f"{len(some)} of {len(all_of_them)}", met


def _none(what: str, found: Verdicts) -> Row:
    return what, "0", _named(found), not found


def _named(found: Verdicts) -> str:
    return f"{len(found)}: {', '.join(each.name for each in found)}" if found else "0"


def _counts(verdicts: Verdicts) -> str:
    words = [each.word for each in verdicts]
    return ", ".join(f"{words.count(word)} {word}" for word in dict.fromkeys(words)) or "-"
