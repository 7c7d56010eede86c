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

"""Exports hold the transform that was calibrated: checked by mathematics of their own."""

import math
import re
import shlex
import subprocess
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from independent_camera import project, turn

from stereo_selfcal import CalibrationResult, ConfigError, Extrinsics, StereoRig
from stereo_selfcal.core.errors import OutputError
from stereo_selfcal.files.exports import EXPORTS, export_paths, parse_exports, write_exports
from stereo_selfcal.files.frames import FrameNames, InfoFrames, place_camera

RIG = StereoRig(640, 480, 516.6, 500.3, 310.5, 250.25, 0.1481)
ODD_FRAME = 'it\'s "the" <car> & a: #1 $HOME 路'
BODY_POINTS = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 3.0, 0.0], [1.0, -2.0, 3.0]])

angles = st.floats(-1.0, 1.0)
poses = st.builds(Extrinsics, st.floats(0.05, 20.0), angles, angles)


def placed(pose, parent="road", child="stereo_camera"):
    """Return a camera over the road, of which no drive has told the yaw."""
    result = CalibrationResult("good", extrinsics=pose, covariance=np.eye(3) * 1e-6, n_frames=1)
    names = FrameNames(road_frame=parent, camera_frame=child)
    return place_camera(result, RIG, names, InfoFrames(of_rig=True))


def text_of(name, pose, parent="road", child="stereo_camera"):
    return EXPORTS[name].text(placed(pose, parent, child), RIG)


def road_points(pose, xyz, rpy):
    """Return the points of the body in the road frame, by turns about fixed axes: X, then Y, then Z."""
    points = BODY_POINTS
    for axis, angle in zip("xyz", rpy, strict=True):
        points = points @ turn(axis, angle).T
    return points + xyz


def assert_pose(pose, xyz, rpy):
    expected = BODY_POINTS @ (turn("y", pose.pitch_rad) @ turn("x", pose.roll_rad)).T
    expected[:, 2] += pose.height_m
    np.testing.assert_allclose(road_points(pose, xyz, rpy), expected, rtol=0, atol=1e-12)


@given(poses)
def test_urdf_holds_the_transform(pose):
    root = ElementTree.fromstring(text_of("urdf", pose).encode())
    assert root.tag == "robot" and root.get("name")
    (joint,) = root
    assert (joint.tag, joint.get("type"), joint.get("name")) == ("joint", "fixed", "road_to_stereo_camera")
    assert joint.find("parent").get("link") == "road"
    assert joint.find("child").get("link") == "stereo_camera"
    origin = joint.find("origin")
    assert_pose(pose, *(np.array(origin.get(name).split(), dtype=float) for name in ("xyz", "rpy")))


def publisher_options(text):
    """Return the options of the one command of a script, as its shell sees them."""
    (line,) = [line for line in text.split("\n") if line and not line.startswith("#")]
    words = shlex.split(line)
    assert words[:4] == ["ros2", "run", "tf2_ros", "static_transform_publisher"]
    return dict(zip(words[4::2], words[5::2], strict=True))


@given(poses)
def test_static_transform_publisher_holds_the_transform(pose):
    options = publisher_options(text_of("static_transform_publisher", pose))
    names = ["--x", "--y", "--z", "--roll", "--pitch", "--yaw"]
    assert list(options) == [*names, "--frame-id", "--child-frame-id"]
    assert (options["--frame-id"], options["--child-frame-id"]) == ("road", "stereo_camera")
    values = [float(options[name]) for name in names]
    assert_pose(pose, values[:3], values[3:])


@given(poses)
def test_autoware_holds_the_transform(pose):
    document = yaml.safe_load(text_of("autoware", pose))
    assert list(document) == ["road"] and list(document["road"]) == ["stereo_camera"]
    values = document["road"]["stereo_camera"]
    assert list(values) == ["x", "y", "z", "roll", "pitch", "yaw"]
    assert all(isinstance(value, float) for value in values.values())
    assert_pose(pose, list(values.values())[:3], list(values.values())[3:])


@given(poses, st.integers(0, 2**32 - 1))
def test_homographies_put_road_points_where_the_cameras_see_them(pose, seed):
    document = yaml.safe_load(text_of("homographies", pose))
    assert (document["road_frame"], document["camera_frame"]) == ("road", "stereo_camera")
    assert (document["image_width"], document["image_height"]) == (640, 480)
    xy = np.random.default_rng(seed).uniform((60.0, -20.0), (200.0, 20.0), (20, 2))
    for camera in ("left", "right"):
        matrix = np.array(document[camera]["image_from_road"])
        assert matrix.shape == (3, 3)
        mapped = np.column_stack([xy, np.ones(len(xy))]) @ matrix.T
        # The depth of a point: how far it is from the body's origin along the body's x axis.
        forward = (turn("y", pose.pitch_rad) @ turn("x", pose.roll_rad))[:, 0]
        relative = np.column_stack([xy, np.full(len(xy), -pose.height_m)])
        np.testing.assert_allclose(mapped[:, 2], relative @ forward, rtol=1e-9, atol=1e-9)
        ahead = mapped[:, 2] > 1.0
        expected = project(RIG, pose, camera, np.column_stack([xy, np.zeros(len(xy))])[ahead])
        np.testing.assert_allclose(mapped[ahead, :2] / mapped[ahead, 2:], expected, rtol=0, atol=1e-6)


def test_left_camera_is_the_left_one():
    """A point straight ahead is seen to the right of the middle by the left camera."""
    document = yaml.safe_load(text_of("homographies", Extrinsics(1.4, 0.0, 0.0)))
    u, _, depth = np.array(document["left"]["image_from_road"]) @ [10.0, 0.0, 1.0]
    assert u / depth == pytest.approx(RIG.cx + RIG.fx * RIG.baseline_m / 2 / 10.0)


def test_any_frame_keeps_its_name():
    pose = Extrinsics(1.4, 0.05, -0.01)
    joint = ElementTree.fromstring(text_of("urdf", pose, ODD_FRAME, ODD_FRAME).encode()).find("joint")
    assert joint.find("parent").get("link") == joint.find("child").get("link") == ODD_FRAME
    options = publisher_options(text_of("static_transform_publisher", pose, ODD_FRAME, "-x"))
    assert (options["--frame-id"], options["--child-frame-id"]) == (ODD_FRAME, "-x")
    for name in ("true", "1e5", ODD_FRAME):
        assert list(yaml.safe_load(text_of("autoware", pose, name))) == [name]
        assert yaml.safe_load(text_of("homographies", pose, name))["road_frame"] == name


def test_names_have_no_slashes_at_the_front_and_no_blanks_around_them():
    """As tf2 refuses them."""
    pose = Extrinsics(1.4, 0.05, -0.01)
    root = ElementTree.fromstring(text_of("urdf", pose, " /asphalt", "//front/cam ").encode())
    joint = root.find("joint")
    assert joint.get("name") == "asphalt_to_front/cam"
    assert joint.find("parent").get("link") == "asphalt"
    assert joint.find("child").get("link") == "front/cam"
    options = publisher_options(text_of("static_transform_publisher", pose, " /asphalt", "//front/cam "))
    assert (options["--frame-id"], options["--child-frame-id"]) == ("asphalt", "front/cam")
    document = yaml.safe_load(text_of("autoware", pose, " /asphalt", "//front/cam "))
    assert list(document) == ["asphalt"] and list(document["asphalt"]) == ["front/cam"]
    document = yaml.safe_load(text_of("homographies", pose, " /asphalt", "//front/cam "))
    assert (document["road_frame"], document["camera_frame"]) == ("asphalt", "front/cam")


def test_script_is_one_command_to_a_real_shell(tmp_path):
    """Run with a ros2 that shows what it gets."""
    (path,) = write_exports(
        tmp_path / "out.yaml",
        ["static_transform_publisher"],
        placed(Extrinsics(1.4, 1e-5, -0.01), ODD_FRAME, "$(touch x)"),
        RIG,
    )
    (tmp_path / "ros2").write_text('#!/bin/sh\nfor word in "$@"; do echo "$word"; done\n')
    (tmp_path / "ros2").chmod(0o755)
    run = subprocess.run(
        ["/bin/sh", str(path)],
        env={"PATH": f"{tmp_path}:/usr/bin:/bin"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=True,
    )
    words = run.stdout.splitlines()
    assert words[words.index("--pitch") + 1] == "1e-05"
    assert words[-3:] == [ODD_FRAME, "--child-frame-id", "$(touch x)"]
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize("name", EXPORTS)
def test_every_text_names_its_units_and_axes_and_is_the_same_every_time(name):
    pose = Extrinsics(1.4, 0.05, -0.01)
    text = text_of(name, pose)
    assert re.search(r"metres", text) and re.search(r"x forward, y left|metres ahead", text)
    assert text == text_of(name, pose)
    assert text.endswith("\n") and max(map(len, text.splitlines())) < 250


def test_files_are_written_beside_the_result(tmp_path):
    pose = Extrinsics(1.4, math.radians(3), -0.01)
    (tmp_path / "front.autoware.yaml").write_text("an older one")
    paths = write_exports(tmp_path / "front.yaml", list(EXPORTS), placed(pose, "road", "front"), RIG)
    assert [path.name for path in paths] == [
        "front.urdf.xml",
        "front.static_transform_publisher.sh",
        "front.autoware.yaml",
        "front.homographies.yaml",
    ]
    assert paths == export_paths(tmp_path / "front.yaml", list(EXPORTS))
    assert sorted(tmp_path.iterdir()) == sorted(paths)
    for path, name in zip(paths, EXPORTS, strict=True):
        assert path.read_text(encoding="utf-8") == text_of(name, pose, "road", "front")
    assert write_exports(tmp_path / "front.yaml", [], placed(pose), RIG) == []


def test_a_script_can_be_run_by_all_who_may_read_it_and_nothing_else_can(tmp_path):
    paths = write_exports(tmp_path / "out.yaml", list(EXPORTS), placed(Extrinsics(1.4, 0.0, 0.0)), RIG)
    runnable = {path.name: path.stat().st_mode & 0o111 for path in paths}
    readable = {path.name: path.stat().st_mode & 0o444 for path in paths}
    assert runnable.pop(script := "out.static_transform_publisher.sh") == readable[script] >> 2 != 0
    assert not any(runnable.values())


@pytest.mark.parametrize("frame", ["a\nb", "a\0b", "caf\udce9"])
def test_frame_that_some_format_cannot_hold_writes_nothing(tmp_path, frame):
    with pytest.raises(OutputError, match="cannot be exported"):
        write_exports(
            tmp_path / "out.yaml", list(EXPORTS), placed(Extrinsics(1.4, 0.0, 0.0), "road", frame), RIG
        )
    assert list(tmp_path.iterdir()) == []


def test_export_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "out.autoware.yaml").mkdir()
    with pytest.raises(OutputError, match=r"out\.autoware\.yaml cannot be written: it is not a file"):
        write_exports(tmp_path / "out.yaml", ["autoware"], placed(Extrinsics(1.4, 0.0, 0.0)), RIG)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("", ()),
        (" , ", ()),
        ("urdf", ("urdf",)),
        (" autoware, urdf ,autoware,", ("autoware", "urdf")),
        (",".join(EXPORTS), tuple(EXPORTS)),
    ],
)
def test_names_are_read_from_a_list(text, names):
    assert parse_exports(text) == names


@pytest.mark.parametrize("text", ["tf", "urdf;autoware", "URDF"])
def test_unknown_name_is_refused_with_those_there_are(text):
    with pytest.raises(ConfigError) as error:
        parse_exports(text)
    assert repr(text) in str(error.value) and ", ".join(EXPORTS) in str(error.value)
