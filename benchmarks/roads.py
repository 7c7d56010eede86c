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

"""Real roads, and rendered ones of others: what is accepted, how right it is, and what a peer makes of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from .frames import UNITS, Array
from .options import Options
from .road_pairs import SEQUENCE_MEAN, SOURCES, STRAIGHT, pairs_of
from .road_summary import summary_table
from .road_verdicts import (
    RIGHT_SIGMAS,
    RoadVerdict,
    in_processes,
    judge,
    rms_of,
    robust_std_of,
)
from .table import Table, numbers
from .worlds import GROSS, WRONG, WRONG_SIGMAS

Verdicts = Sequence[RoadVerdict]

TITLES = {
    "kitti_frames": "Real cars (KITTI, single frames): difference to lidar - 15 mm",
    "kitti_odometry02": "A recorded drive with lines (KITTI odometry 02): difference to its dense disparity",
    "kitti_odometry07": "A street with hardly any paint (KITTI odometry 07): difference to "
    + numbers(SEQUENCE_MEAN),
    "roads": "Pairs of other cameras: how far outside of what planes of dense disparity have",
    "worlds": "Rendered pairs of others: difference to the truth",
}
_UNIT_CELLS = ("mm", "deg", "deg")
_DIGITS = (0, 2, 2)


def road_tables(options: Options) -> Iterator[Table]:
    """Judge every pair of every set: a summary, the peer, each set, and all pairs in one file."""
    sources = options.sources or tuple(SOURCES)
    pairs = pairs_of(sources, options.road_step)
    verdicts = list(in_processes(judge, pairs, options.processes))
    of_source = {source: [each for each in verdicts if each.source == source] for source in sources}
    yield summary_table(of_source)
    yield _errors(of_source)
    yield _peer(of_source)
    for source, found in of_source.items():
        yield _pairs(source, found)
    yield every_pair("roads_every", verdicts)


def _errors(of_source: dict[str, list[RoadVerdict]]) -> Table:
    """Return the errors by set and tag."""
    table = Table(
        "roads_errors",
        "Real and rendered roads by kind: errors of what is accepted",
        [
            "set",
            "kind",
            "accepted",
            "off",
            "wrong",
            "gross",
            "mean error",
            "median of |error|",
            "90 %",
            "median std",
            "error / std, RMS",
            "robust",
        ],
        f"Errors: {', '.join(UNITS)}. Off: by more than {RIGHT_SIGMAS:g} standard deviations of estimate and "
        f"reference together. Wrong: by more than {WRONG_SIGMAS:g} of them and {numbers(WRONG)}. Gross: by "
        f"more than {numbers(GROSS)}. Error / std has the standard deviation of the reference in it; "
        "robust: 1.48 times the median. What is unknown is left out; the frames of the sequence have no "
        "reference of their own.",
    )
    for source, verdicts in of_source.items():
        tags = list(dict.fromkeys(each.tag for each in verdicts)) if source != "roads" else []
        groups = [(tag, [each for each in verdicts if each.tag == tag]) for tag in tags]
        if len(groups) != 1:
            groups.append(("all", verdicts))
        for tag, group in groups:
            accepted = [each for each in group if each.accepted]
            counts = [sum(each.word == word for each in group) for word in ("off", "wrong", "gross")]
            cells = [source, tag, f"{len(accepted)} of {len(group)}", *map(str, counts)]
            table.add(*cells, *_error_cells(accepted))
    return table


def _error_cells(accepted: Verdicts) -> list[str]:
    known = [each for each in accepted if np.isfinite(each.error).any()]
    if not known:
        return ["-"] * 6
    errors, std = np.array([each.error for each in known]), np.array([each.std for each in known])
    sigmas = np.array([each.sigmas for each in known if np.isfinite(each.reference_std).all()])
    return [
        signed(np.nanmean(errors, axis=0)),
        numbers(np.nanmedian(np.abs(errors), axis=0)),
        numbers(np.nanquantile(np.abs(errors), 0.9, axis=0)),
        numbers(np.median(std, axis=0)),
        numbers(rms_of(sigmas)) if len(sigmas) else "-",
        numbers(robust_std_of(sigmas)) if len(sigmas) else "-",
    ]


def _peer(of_source: dict[str, list[RoadVerdict]]) -> Table:
    """Return ours and the peer's errors side by side."""
    table = Table(
        "roads_peer",
        "Against thirty lines of OpenCV: SGBM, RANSAC plane, least squares",
        ["set", "method", "answers", "gross", "median of |error|", "90 %", "median CPU ms"],
        "The peer: 96 disparities, block 5, the settings of OpenCV's sample; a plane by RANSAC, then "
        "least squares, within half a pixel, of what is 4 to 25 m ahead and 4 m to either side in the lower "
        f"half of the image. It never refuses what has a plane. Errors: {', '.join(UNITS)}; gross as above. "
        "In common: pairs that both answer. Ratio: ours by the peer's. The errors of the sequence hold the "
        "motion of the car, so that none of them is called gross.",
    )
    for source, verdicts in of_source.items():
        groups: list[tuple[str, Verdicts]] = [(source, verdicts)]
        if source == "kitti_frames":
            groups.append((f"{source}, {STRAIGHT}", [each for each in verdicts if each.tag == STRAIGHT]))
            both = [each for each in verdicts if each.accepted and len(each.peer)]
            groups.append((f"{source}, in common", both))
        for name, group in groups:
            ours = [each.error for each in group if each.accepted]
            theirs = [each.peer_error for each in group if len(each.peer)]
            for method, errors, gross, seconds in (
                ("ours", ours, sum(each.gross for each in group), [each.cpu_s for each in group]),
                ("peer", theirs, sum(each.peer_gross for each in group), [each.peer_cpu_s for each in group]),
            ):
                cells = [name, method, f"{len(errors)} of {len(group)}", str(gross)]
                milliseconds = f"{np.median(seconds) * 1e3:.0f}" if seconds else "-"
                table.add(*cells, *map(_cell, quantiles(errors)), milliseconds)
            ratios = [mine / other for mine, other in zip(quantiles(ours), quantiles(theirs), strict=True)]
            answers = f"{len(ours) / len(theirs):.2f}" if theirs else "-"
            table.add(name, "ratio", answers, "", *map(_cell, ratios), "")
    return table


def quantiles(errors: Sequence[Array]) -> tuple[Array, Array]:
    """Return median and 90 % of the absolute errors, NaN of none."""
    if not errors or not np.isfinite(errors).any():
        return np.full(3, np.nan), np.full(3, np.nan)
    absolute = np.abs(errors)
    return np.nanmedian(absolute, axis=0), np.nanquantile(absolute, 0.9, axis=0)


def _cell(values: Array) -> str:
    return numbers(values) if np.isfinite(values).any() else "-"


def _pairs(source: str, verdicts: Verdicts) -> Table:
    """Return one row for each pair of a set."""
    table = Table(
        f"roads_{source}",
        TITLES[source],
        [
            "pair",
            "kind",
            "verdict",
            "reason",
            "error (mm, deg, deg)",
            "std",
            "error / std",
            "stage",
            "peer's error",
        ],
        "(!): not what is expected of the pair.",
    )
    for each in verdicts:
        std = numbers(each.std) if each.accepted else "-"
        shown = [signed(each.error), std, signed(each.sigmas, (1, 1, 1))]
        verdict = f"{each.word} (!)" if each.at_fault else each.word
        table.add(
            each.name,
            each.tag,
            verdict,
            each.reason or "-",
            *shown,
            each.stage or "-",
            signed(each.peer_error),
        )
    return table


def every_pair(name: str, verdicts: Verdicts) -> Table:
    """Return all that is known of every pair, for a file and not for the page."""
    columns: dict[str, Callable[[RoadVerdict], Array]] = {
        "pose": lambda each: each.pose,
        "std": lambda each: each.std,
        "error": lambda each: each.error,
        "sigmas": lambda each: each.sigmas,
        "low": lambda each: each.low,
        "high": lambda each: each.high,
        "peer": lambda each: each.peer,
        "peer_error": lambda each: each.peer_error,
    }
    header = ["set", "pair", "kind", "expected", "verdict", "reason", "stage", "cpu_s", "peer_cpu_s"]
    axes = [f"{what}_{axis}" for what in columns for axis in ("height_mm", "pitch_deg", "roll_deg")]
    table = Table(name, "Every pair", [*header, *axes, "message"], shown=False)
    for each in verdicts:
        values = [cell for of in columns.values() for cell in _csv_cells(of(each))]
        table.add(
            each.source,
            each.name,
            each.tag,
            each.expected,
            each.word,
            each.reason,
            each.stage,
            f"{each.cpu_s:.3f}",
            f"{each.peer_cpu_s:.3f}",
            *values,
            each.message,
        )
    return table


def _csv_cells(values: Array) -> list[str]:
    return [f"{value:.4f}" if np.isfinite(value) else "" for value in values] if len(values) else [""] * 3


def signed(values: Array, digits: tuple[int, ...] = _DIGITS) -> str:
    """Return three values with their signs in a cell, "-" for none."""
    if not len(values) or not np.isfinite(values).any():
        return "-"
    return " / ".join(
        f"{value:+.{n}f}" if np.isfinite(value) else "?" for value, n in zip(values, digits, strict=True)
    )
