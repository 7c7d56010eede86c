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

"""The figure of docs/method.md: which modules an image passes through, in their order.

Each row is a stage of the method and has a section in the page. The names of the boxes are those of modules:
``test/test_method.py`` compares them with the package.
"""

from __future__ import annotations

from dataclasses import dataclass

_INK, _FAINT, _LOOP = "#333333", "#666666", "#d55e00"  # Okabe and Ito, as in the drawing of the frames
_FILL, _ALTERNATIVE = "#eaf3fa", "#fdf3e4"
_MONO = "DejaVu Sans Mono, Consolas, monospace"
# All in pixels. The page is 1200 wide at most; a character of the monospaced font is 0.6 of its size wide.
_WIDTH = 1190
_TITLE_WIDTH, _BOX_WIDTH, _GAP = 122, 196, 16
_NAME_SIZE, _TEXT_SIZE, _LINE = 10.5, 11.0, 14.5
_PAD, _ROW_GAP, _TOP = 9.0, 28.0, 46.0
_RAIL = 11.0  # from the first boxes to the line that leads past a row


@dataclass(frozen=True)
class Box:
    """A module on the way.

    Attributes:
        module: Its name, from the package or from core on.
        does: What happens to the image there, in lines that fit into the box.
        uses: Modules that do a part of it.
        alternative: Whether it takes the place of its neighbours, where these cannot be used.
    """

    module: str
    does: tuple[str, ...]
    uses: tuple[str, ...] = ()
    alternative: bool = False


@dataclass(frozen=True)
class Row:
    """A stage: a section of the page.

    Attributes:
        title: Of the section.
        boxes: From left to right.
        each: Whether it is run for every hypothesis.
        branches: Whether the next row takes its place, rather than follows it.
    """

    title: tuple[str, ...]
    boxes: tuple[Box, ...]
    each: bool = False
    branches: bool = False


ROWS = (
    Row(
        ("1 Images",),
        (
            Box(
                "ros/inputs",
                ("images of a topic,", "or of a recording"),
                ("subscriptions", "intake", "calibration", "offline/bag", "bags/reader"),
            ),
            Box(
                "core/camera/pairing", ("left and right image", "of one moment"), ("stamp_pattern", "frozen")
            ),
            Box(
                "core/camera/camera_info",
                ("intrinsics, baseline", "and their faults"),
                ("camera_info_checks", "camera_info_history", "pair_geometry", "rig", "rig_checks"),
            ),
            Box("core/camera/image_messages", ("8-bit grey values",), ("image_header", "bit_depth")),
            Box("core/camera/rectifier", ("rectified images", "of one rig"), ("working_size",)),
        ),
    ),
    Row(
        ("2 Road surface",),
        (
            Box(
                "estimators/coarse_road",
                ("a plane of dense", "disparities, at low", "resolution"),
                ("dense_disparity",),
            ),
            Box(
                "evidence/camera_turn",
                ("rows of both images;", "the right one is turned", "back"),
                ("estimators/matched_points", "estimators/row_alignment"),
            ),
            Box(
                "estimators/texture_alignment",
                ("plane of the road", "surface, from there on"),
                (
                    "texture_search",
                    "cell_displacements",
                    "texture_fit",
                    "sampling",
                    "road/cell_grid",
                    "road/surface",
                    "road/lane_points",
                    "road/unevenness",
                    "road/extent",
                ),
            ),
            Box("evidence/road_surface", ("whether it locates", "the road")),
        ),
    ),
    Row(
        ("3 Lines",),
        (
            Box("lanes/stripe_points", ("left edges of stripes,", "row by row")),
            Box("search/lines_on_road", ("lines on the road", "surface, in both images")),
            Box(
                "lanes/detector",
                ("lines of the whole", "image"),
                ("hough", "following", "line_fit"),
                alternative=True,
            ),
            Box(
                "lanes/matching",
                ("lines that both cameras", "see, and pairs of them"),
                ("lane_pair", "hypotheses", "line_geometry", "frame_checks"),
                alternative=True,
            ),
            Box("lanes/extra_lines", ("other lines of", "the same road")),
        ),
    ),
    Row(
        ("4 Hypotheses",),
        (
            Box("core/calibrator", ("one loop over the", "hypotheses of a frame")),
            Box("search/strategy", ("which hypotheses,", "in which order")),
        ),
    ),
    Row(
        ("5 Pose from", "the lines"),
        (
            Box("search/solve", ("one hypothesis through", "all stages")),
            Box("estimators/fitness", ("misfit of a pose",)),
            Box("numerics/genetic", ("the best pose in", "the search box"), ("estimators/fittest_nearby",)),
            Box(
                "estimators/line_covariance", ("its covariance,", "bends of the road"), ("road/stripe_model",)
            ),
            Box("lanes/closed_form", ("a second estimate,", "for comparison")),
        ),
        each=True,
    ),
    Row(
        ("6 Pose from", "the stripes"),
        (
            Box(
                "estimators/stripe_fit",
                ("fit of the grey values", "at all stripe edges"),
                ("stripe_start", "row_blocks", "edge_response", "gauss_newton"),
            ),
            Box("evidence/profile", ("heights of the road", "along the stripes")),
            Box(
                "evidence/gates",
                ("conditions, evaluated", "after every stage"),
                ("measurements", "surface_measurements", "frame_evidence"),
            ),
            Box("evidence/cross_checks", ("enough texture: stage 7,", "too little: stage 8")),
        ),
        each=True,
    ),
    Row(
        ("7 Cross-check", "by texture"),
        (
            Box("evidence/lane_heights", ("heights of the lines", "over that surface")),
            Box("evidence/row_offset", ("rows of both images", "on the road")),
            Box("evidence/cue_fusion", ("weighted mean of lines", "and texture")),
        ),
        each=True,
        branches=True,
    ),
    Row(
        ("8 Checks of", "lines alone"),
        (
            Box("evidence/stripe_border", ("grey values beside", "the stripes"), alternative=True),
            Box("evidence/kerb_face", ("heights of the edges", "of a stripe"), alternative=True),
            Box("evidence/horizon", ("rows of both images", "along the horizon"), alternative=True),
            Box(
                "estimators/lane_sweep",
                ("faint texture and tracks", "between the lines"),
                ("lane_profile", "evidence/line_readings"),
                alternative=True,
            ),
        ),
        each=True,
    ),
    Row(
        ("9 Uncertainty",),
        (
            Box("evidence/nuisances", ("what is unknown", "besides the pose"), ("road/priors",)),
            Box("geometry/uncertainty", ("covariance as a sum", "of named terms"), ("evidence/estimate",)),
            Box("search/attempt", ("the hypothesis, stages,", "readings and verdict")),
        ),
        each=True,
    ),
    Row(
        ("10 Result",),
        (
            Box("core/results", ("pose and covariance, or", "the reason of a refusal")),
            Box("drive/fusion", ("mean over the frames", "of a drive")),
            Box("files/result_file", ("YAML",)),
        ),
    ),
)

# Modules of core that no image passes through, and why.
NOT_ON_THE_WAY = {
    "errors, types, config, tolerances, rejection, reservations, faults": "read everywhere",
    "numerics/robust, numerics/linear, numerics/derivatives, numerics/statistics, numerics/ragged": (
        "robust fits, equations that may have no solution, derivatives, medians, lists end to end"
    ),
    "geometry/pose, geometry/plane, geometry/rays, geometry/homography": "frames, signs and projections",
    "geometry/vehicle": "the camera in the vehicle's frame",
    "search/known, search/parts_of_time, estimators/texture_following, estimators/stripe_following": (
        "frames that are followed from an accepted cold one"
    ),
    "road_now, search/road_lines, search/known_lines": "the road at this moment, by the known camera",
    "search/refusal, search/diagnosis, search/both_images": "why a frame is refused",
    "evidence/far_disparity, evidence/camera_yaw, evidence/rig_unknowns, "
    "evidence/rig_measurements": "what is unknown of the rig, and what shows it",
    "evidence/synchronisation, estimators/road_shift": "whether both images are of one moment",
    "geometry/alignment, alignment_verdict, delay_report": "how the right camera is turned, whether its "
    "images are late, and what is to be done",
    "drive/drive, drive/changes, drive/time_blocks": "the whole of a drive, and moves of the mount in it",
    "drive/frame_series, drive/motion, numerics/gauss_markov, drive/standing": (
        "how the car moves its camera, or stands"
    ),
    "geometry/mount, drive/targets": "how an estimate of the mount was reached, and when it is good enough",
    "estimators/landmarks, drive/landmark_matches, drive/motion_between_frames, drive/travel, "
    "drive/yaw_change, drive/kept_yaw, geometry/travel": "how the car moves between frames",
    "drive/turn_rates, drive/turn_topics": "what odometry and gyroscopes say of that motion",
    "evidence/told_alignment, drive/rig_alignment, drive/rig_doubt, drive/travel_vergence, "
    "drive/right_delay, drive/mean_over_time, drive/memory": "what a drive tells of the rig",
    "camera/topic_names, camera/camera_difference, drive/camera_changes": "topics, changes of cameras",
    "camera/plain_camera_info, camera/rotations, geometry/camera_info_repair": "CameraInfo, corrected where "
    "the right camera has turned",
    "drive/drift, drive/watch, drive/alignment_watch, drive/states": "the watch over an active calibration",
    "analysis/cramer_rao": "the limit of what a rig can reach",
    "analysis/detection": "the limit of how soon a moved camera can be seen",
}


def modules_in_figure() -> tuple[str, ...]:
    """Return every module that the figure names, as a path from the package on, without its suffix."""
    return tuple(name for row in ROWS for box in row.boxes for name in _modules_of(box))


def modules_beside() -> tuple[str, ...]:
    """Return every module of :data:`NOT_ON_THE_WAY`, in the same form."""
    return tuple(_in_package(name) for names in NOT_ON_THE_WAY for name in names.split(", "))


def data_flow_svg() -> bytes:
    """Draw the figure."""
    tops = _tops()
    parts = [part for row, top in zip(ROWS, tops, strict=True) for part in _draw_row(row, top)]
    parts += _connections(tops)
    inner = [(top, _row_height(row)) for row, top in zip(ROWS, tops, strict=True) if row.each]
    loop_top, loop_bottom = inner[0][0] - _LINE - 6, inner[-1][0] + inner[-1][1] + 12
    height = tops[-1] + _row_height(ROWS[-1]) + 12
    frame = [
        _text(_PAD, 22, "The way of an image through the modules", _INK, size=15, bold=True),
        _rectangle(462, 11, 18, 13, _FILL),
        _text(487, 22, "a module, and in italics those that do a part of its work", _FAINT),
        _rectangle(872, 11, 18, 13, _ALTERNATIVE),
        _text(897, 22, "takes the place of what cannot be used", _FAINT),
        f'<rect x="6" y="{loop_top:.1f}" width="{_WIDTH - 12}" height="{loop_bottom - loop_top:.1f}" rx="8" '
        f'fill="none" stroke="{_LOOP}" stroke-width="1.5" stroke-dasharray="7 4"/>',
        _text(14, loop_top + 15, "for each hypothesis", _LOOP, bold=True),
    ]
    body = "\n".join([*frame, *parts])
    return f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height:.0f}"
 width="{_WIDTH}" font-family="DejaVu Sans, Verdana, sans-serif" font-size="{_TEXT_SIZE}">
<title>The way of an image through the modules of stereo_selfcal</title>
<defs><marker id="head" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7" orient="auto">\
<path d="M0 0 L10 5 L0 10 z" fill="{_INK}"/></marker></defs>
<rect width="{_WIDTH}" height="{height:.0f}" rx="6" fill="#ffffff"/>
{body}
</svg>
""".encode()


def _tops() -> list[float]:
    """Return where each row begins; the frame around those of a hypothesis has room of its own."""
    tops, top, before = [], _TOP, False
    for row in ROWS:
        top += (_LINE if row.each else 10.0) * (row.each != before)
        tops.append(top)
        top += _row_height(row) + _ROW_GAP
        before = row.each
    return tops


def _row_height(row: Row) -> float:
    return max(2 * _PAD + 6 + _LINE * (len(box.does) + len(box.uses)) for box in row.boxes)


def _left_of(column: int) -> float:
    return _PAD + _TITLE_WIDTH + column * (_BOX_WIDTH + _GAP)


def _connections(tops: list[float]) -> list[str]:
    """Draw how each row leads to the next; a row that takes the place of another is led past it."""
    parts = []
    first = _left_of(0) + _BOX_WIDTH / 2
    rail = _left_of(0) - _RAIL
    for index in range(len(ROWS) - 1):
        row, top, height = ROWS[index], tops[index], _row_height(ROWS[index])
        bottom, next_top = top + height, tops[index + 1]
        last = _left_of(len(row.boxes) - 1)
        if row.branches:
            # Past the other row, along the right side, to the one after it.
            right = last + _BOX_WIDTH + _GAP
            turn = tops[index + 2] - _GAP / 2 - 4
            start = (last + _BOX_WIDTH, top + height / 2)
            parts.append(_path(start, (right, start[1]), (right, turn), (first, turn)))
            # Past this row, along its left side, to the other one.
            y = next_top + _row_height(ROWS[index + 1]) / 2
            turn = top - _GAP / 2 - 4
            parts.append(_path((first, turn), (rail, turn), (rail, y), (_left_of(0), y), arrow=True))
            continue
        x, turn = last + _BOX_WIDTH / 2, next_top - _GAP / 2 - 4
        if len(row.boxes) == 1:
            parts.append(_path((first, bottom), (first, next_top), arrow=True))
        else:
            parts.append(_path((x, bottom), (x, turn), (first, turn), (first, next_top), arrow=True))
    return parts


def _draw_row(row: Row, top: float) -> list[str]:
    parts = [_text(14, top + 20 + 16 * i, line, _INK, size=12, bold=True) for i, line in enumerate(row.title)]
    height = _row_height(row)
    middle = top + height / 2
    for index, box in enumerate(row.boxes):
        left = _left_of(index)
        parts += _draw_box(box, left, top, height)
        if index:
            parts.append(_path((left - _GAP, middle), (left, middle), arrow=True))
    return parts


def _draw_box(box: Box, left: float, top: float, height: float) -> list[str]:
    fill = _ALTERNATIVE if box.alternative else _FILL
    parts = [
        _rectangle(left, top, _BOX_WIDTH, height, fill),
        _text(left + 7, top + _PAD + 8, box.module.removeprefix("core/"), _INK, mono=True, bold=True),
    ]
    y = top + _PAD + 8
    for line in box.does:
        y += _LINE
        parts.append(_text(left + 7, y, line, _INK))
    for line in box.uses:
        y += _LINE
        parts.append(_text(left + 7, y, line, _FAINT, mono=True, italic=True))
    return parts


def _rectangle(left: float, top: float, width: float, height: float, fill: str) -> str:
    return (
        f'<rect x="{left:.1f}" y="{top:.1f}" width="{width:.0f}" height="{height:.1f}" rx="4" '
        f'fill="{fill}" stroke="{_INK}"/>'
    )


def _path(*points: tuple[float, float], arrow: bool = False) -> str:
    places = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    head = ' marker-end="url(#head)"' if arrow else ""
    return f'<polyline points="{places}" fill="none" stroke="{_INK}" stroke-width="1.4"{head}/>'


def _text(
    x: float,
    y: float,
    words: str,
    colour: str,
    *,
    size: float = _TEXT_SIZE,
    mono: bool = False,
    bold: bool = False,
    italic: bool = False,
) -> str:
    more = f' font-family="{_MONO}" font-size="{_NAME_SIZE}"' if mono else f' font-size="{size}"'
    more += ' font-weight="bold"' if bold else ""
    more += ' font-style="italic"' if italic else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="{colour}"{more}>{words}</text>'


def _modules_of(box: Box) -> list[str]:
    own = _in_package(box.module)
    room = own.rpartition("/")[0]
    return [own, *(_in_package(name) if "/" in name else f"{room}/{name}" for name in box.uses)]


def _in_package(name: str) -> str:
    """Return the path of a module from the package on: rooms of core are named without core."""
    folder, _, rest = name.partition("/")
    return name if rest and folder in ("core", "ros", "files", "offline", "bags") else f"core/{name}"
