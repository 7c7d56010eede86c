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

"""A rig from a file or from parameters is checked as one from CameraInfo is."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
import yaml
from bag_making import cameras, make_bag

from stereo_selfcal.core.camera.camera_info import CameraInfoError, InfoReason
from stereo_selfcal.core.camera.rectifier import StereoRectifier
from stereo_selfcal.core.camera.rig import StereoRig
from stereo_selfcal.core.errors import RigError
from stereo_selfcal.files.rig_file import read_rig_file
from stereo_selfcal.offline import open_source
from stereo_selfcal.ros.pair_source import known_rectifier

GOOD = StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481)
IMPOSSIBLE = {
    "baseline in millimetres": (
        {"baseline_m": 148.1},
        r"baseline_m is 148\.1 m.*in metres \(.*0\.1481 m\)",
    ),
    "baseline of a hair": ({"baseline_m": 0.0002867}, r"baseline_m is 0\.0002867 m, at least 0\.005 m"),
    "cx left out": ({"cx": 0.0}, "rig.cx is 0 px, the border of the 640 x 480 image"),
    "cy left out": ({"cy": 0}, "rig.cy is 0 px"),
    "f in millimetres": (
        {"fx": 3.6, "fy": 3.6},
        r"focal length of 3\.6 x 3\.6 px.*178\.7 deg.*pixels",
    ),
    "fx alone in millimetres": ({"fx": 3.6}, r"focal length of 3\.6 x 516\.6 px"),
}
DOUBTFUL = {
    "long baseline": ({"baseline_m": 2.5}, InfoReason.BASELINE_UNUSUAL, "baseline is 2.5 m"),
    "cx of half the resolution": ({"cx": 80.0}, InfoReason.PRINCIPAL_POINT, "principal point (80, 239.5)"),
    "cy of twice the resolution": (
        {"cy": 470.0},
        InfoReason.PRINCIPAL_POINT,
        "(319.5, 470) of the rig",
    ),
    "wide": ({"fx": 80.0, "fy": 80.0}, InfoReason.FOCAL_LENGTH_UNUSUAL, "sees 152 degrees"),
    "long": ({"fx": 5000.0, "fy": 5000.0}, InfoReason.FOCAL_LENGTH_UNUSUAL, "sees 7.32 degrees"),
    "fx of twice the resolution": ({"fx": 1200.0}, InfoReason.FOCAL_LENGTH_UNUSUAL, "is 1200 x 516.6 px"),
}


def node_config(rig):
    return SimpleNamespace(rig_from_parameters=lambda: rig)


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_rig_that_no_car_has_is_refused_with_value_and_unit(tmp_path, name):
    changes, message = IMPOSSIBLE[name]
    path = tmp_path / "rig.yaml"
    path.write_text(yaml.safe_dump({**GOOD.to_mapping(), **changes}))
    with pytest.raises(RigError, match=message):
        read_rig_file(path)
    with pytest.raises(RigError, match=message):
        known_rectifier(None, node_config(replace(GOOD, **changes)))


@pytest.mark.parametrize("name", DOUBTFUL)
def test_what_is_doubtful_about_a_rig_from_a_file_is_told_with_its_value(tmp_path, name):
    changes, reason, message = DOUBTFUL[name]
    path = tmp_path / "rig.yaml"
    path.write_text(yaml.safe_dump({**GOOD.to_mapping(), **changes}))
    rig = read_rig_file(path)
    with open_source([make_bag(tmp_path / "bag", cameras(), 1)], rig=rig) as source:
        assert [message in remark for remark in source.remarks] == [True]
    (doubt,) = known_rectifier(None, node_config(rig)).doubts
    assert doubt.reason is reason and message in doubt.message


@pytest.mark.parametrize(
    "rig",
    [
        GOOD,
        StereoRig(1242, 375, 721.5, 721.5, 609.5, 172.8, 0.54),
        StereoRig(752, 480, 435.2, 435.2, 367.2, 252.2, 0.11),
        StereoRig(640, 240, 516.6, 258.3, 319.5, 119.5, 0.12),
    ],
    ids=["paper", "KITTI", "EuRoC", "rows binned"],
)
def test_nothing_is_said_of_a_usual_rig(rig):
    assert StereoRectifier.of_rig(rig).doubts == ()


def test_focal_length_of_camera_info_in_millimetres_is_refused():
    def info(p3):
        p = [3.6, 0, 319.5, p3, 0, 3.6, 239.5, 0, 0, 0, 1, 0]
        k = [3.6, 0, 319.5, 0, 3.6, 239.5, 0, 0, 1]
        size = {"width": 640, "height": 480}
        return SimpleNamespace(**size, distortion_model="", k=k, d=[], r=[1, 0, 0, 0, 1, 0, 0, 0, 1], p=p)

    with pytest.raises(CameraInfoError, match=r"CameraInfo gives a focal length of 3\.6 x 3\.6 px") as caught:
        StereoRectifier.from_camera_info(info(0.0), info(-3.6 * 0.12))
    assert caught.value.reason is InfoReason.FOCAL_LENGTH_IMPLAUSIBLE
