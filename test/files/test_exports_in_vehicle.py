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

"""Every export carries a point of the left image to where the truth of a rendered road has it."""

import math
import shlex
from xml.etree import ElementTree

import numpy as np
import painted_square as scene
import pytest
import yaml

from stereo_selfcal.core.errors import OutputError
from stereo_selfcal.files.exports import EXPORTS, write_exports
from stereo_selfcal.files.frames import FROM_CAMERA_INFO, FrameNames, InfoFrames, place_camera

INFOS = InfoFrames("zed_left_optical", "zed_right_optical")
CHILDREN = {False: "stereo_camera", True: FROM_CAMERA_INFO}
NAMES = ("x", "y", "z", "roll", "pitch", "yaw")


def placed(optical, yaw_known=True, **names):
    frames = FrameNames(camera_frame=CHILDREN[optical], place=scene.PLACE, **names)
    return place_camera(scene.calibrated(yaw_known), scene.RIG, frames, INFOS)


def read_urdf(text):
    joint = ElementTree.fromstring(text.encode()).find("joint")
    origin = joint.find("origin")
    values = [*origin.get("xyz").split(), *origin.get("rpy").split()]
    return joint.find("parent").get("link"), joint.find("child").get("link"), [float(each) for each in values]


def read_static_transform_publisher(text):
    words = shlex.split(text.splitlines()[-1])
    options = dict(zip(words[4::2], words[5::2], strict=True))
    values = [float(options[f"--{name}"]) for name in NAMES]
    return options["--frame-id"], options["--child-frame-id"], values


def read_autoware(text):
    ((parent, children),) = yaml.safe_load(text).items()
    ((child, values),) = children.items()
    return parent, child, [values[name] for name in NAMES]


READERS = {
    "urdf": read_urdf,
    "static_transform_publisher": read_static_transform_publisher,
    "autoware": read_autoware,
}


@pytest.mark.parametrize("optical", [False, True], ids=["body", "optical"])
@pytest.mark.parametrize("name", READERS)
def test_point_of_the_left_image_lies_where_the_truth_has_it(name, optical):
    text = EXPORTS[name].text(placed(optical), scene.RIG)
    parent, child, values = READERS[name](text)
    assert (parent, child) == ("base_footprint", "zed_left_optical" if optical else "stereo_camera")
    found = scene.square_on_road(np.array(values[:3]), scene.fixed_axes(*values[3:]), optical)
    assert found == pytest.approx(scene.TRUTH_M, abs=scene.TOLERANCE_M)


@pytest.mark.parametrize("optical", [False, True], ids=["body", "optical"])
@pytest.mark.parametrize("name", READERS)
def test_without_the_yaw_the_point_lies_in_the_road_frame_turned_by_it(name, optical):
    parent, _, values = READERS[name](EXPORTS[name].text(placed(optical, yaw_known=False), scene.RIG))
    assert parent == "road"
    found = scene.square_on_road(np.array(values[:3]), scene.fixed_axes(*values[3:]), optical)
    # The road's frame lies under the middle of the baseline.
    ahead, left = scene.AHEAD_M, scene.LEFT_M - scene.LATERAL_M
    expected = scene.about((0.0, 0.0, 1.0), -scene.YAW_RAD) @ [ahead, left, 0.0]
    assert found == pytest.approx(expected, abs=scene.TOLERANCE_M)


def test_the_measure_itself_tells_a_yaw_of_a_tenth_of_a_degree():
    """Else the tests above could not fail."""
    transform = placed(optical=False).camera.transform
    turned = scene.about((0.0, 0.0, 1.0), math.radians(0.1)) @ transform.rotation
    found = scene.square_on_road(transform.translation_m, turned, optical=False)
    assert np.abs(found - scene.TRUTH_M).max() > 1.5 * scene.TOLERANCE_M


@pytest.mark.parametrize("name", READERS)
def test_comment_says_which_frames_and_whether_the_yaw_is_known(name):
    def comment(**kwargs):
        return EXPORTS[name].text(placed(**kwargs), scene.RIG)

    assert "Camera body (x forward, y left, z up; in the middle" in comment(optical=False)
    assert "the direction of travel; the yaw is known)" in comment(optical=False)
    assert "Optical frame of the left camera (x right, y down, z forward)" in comment(optical=True)
    assert "along its heading; yaw 0, as it is not known)" in comment(optical=True, yaw_known=False)
    assert "along its heading; yaw 0)" in comment(optical=False, vehicle_frame="road")


def test_homographies_stay_over_the_road_and_say_so():
    text = EXPORTS["homographies"].text(placed(optical=True), scene.RIG)
    document = yaml.safe_load(text)
    assert (document["road_frame"], document["camera_frame"]) == ("road", "zed_left_optical")
    assert "heading of the camera, which is not the direction of travel" in text
    unknown = yaml.safe_load(EXPORTS["homographies"].text(placed(optical=True, yaw_known=False), scene.RIG))
    assert document["left"] == unknown["left"]


def test_camera_without_a_name_is_exported_nowhere(tmp_path):
    frames = FrameNames(camera_frame=FROM_CAMERA_INFO)
    nameless = place_camera(scene.calibrated(), scene.RIG, frames, InfoFrames())
    with pytest.raises(OutputError, match=r"camera_frame is from_camera_info, but .* has no frame_id: set"):
        write_exports(tmp_path / "out.yaml", ["homographies", "urdf"], nameless, scene.RIG)
    assert list(tmp_path.iterdir()) == []
