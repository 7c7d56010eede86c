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

"""CameraInfo files hold what camera_info_manager reads, and are read back as they were written."""

import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from stereo_selfcal import CalibrationResult, Extrinsics, RigError, StereoRig
from stereo_selfcal.core.camera.plain_camera_info import PlainCameraInfo, RegionOfInterest
from stereo_selfcal.core.camera.rectifier import StereoRectifier
from stereo_selfcal.core.errors import OutputError
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.core.geometry.camera_info_repair import repair_camera_info, repaired_pairs
from stereo_selfcal.files.camera_info_file import format_camera_info, is_ours, read_camera_info_file
from stereo_selfcal.files.exports import CAMERA_INFO, camera_infos, export_paths, write_exports
from stereo_selfcal.files.frames import FrameNames, InfoFrames, place_camera

RIG = StereoRig(640, 480, 516.6, 500.3, 310.5, 250.25, 0.1481)
POSED = CalibrationResult("good", extrinsics=Extrinsics(1.4, 0.05, -0.01), covariance=np.eye(3) * 1e-6)
PLACED = place_camera(POSED, RIG, FrameNames(), InfoFrames())
TURNED = Alignment(0.002, 0.003, -0.002, np.diag([1e-8, 1e-8, 1e-8]))
NAMES = "d", "k", "r", "p"

# As cameracalibrator of ROS writes them.
OF_CAMERA_CALIBRATION = """\
image_width: 640
image_height: 480
camera_name: narrow_stereo/right
camera_matrix:
  rows: 3
  cols: 3
  data: [517.83, 0.     , 310.1  ,
           0.     , 516.21, 251.3,
           0.     , 0.     , 1.     ]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.31, 0.1, 1e-05, -0.0007, 0.]
rectification_matrix:
  rows: 3
  cols: 3
  data: [ 0.99998, 0.00551, 0.00280,
         -0.00552, 0.99997, 0.00464,
         -0.00277, -0.00465, 0.99998]
projection_matrix:
  rows: 3
  cols: 4
  data: [501.2, 0.     , 305.7,  -74.2,
           0.     , 501.2, 248.1,   0.     ,
           0.     , 0.     , 1.     ,   0.     ]
"""


def same(one, other):
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in NAMES) and all(
        getattr(one, name) == getattr(other, name)
        for name in ("width", "height", "distortion_model", "binning_x", "binning_y", "roi")
    )


numbers = st.floats(-1e4, 1e4)


@given(st.lists(numbers, max_size=14), st.lists(numbers, min_size=30, max_size=30), st.integers(0, 4))
def test_what_is_written_is_read_with_all_its_digits(tmp_path_factory, d, values, binning):
    path = tmp_path_factory.mktemp("files") / "left.yaml"
    k, r, p = (np.array(part) for part in (values[:9], values[9:18], values[18:]))
    region = RegionOfInterest(binning, 0, 10 * binning, 20 * binning)
    info = PlainCameraInfo(640, 480, "plumb_bob", np.array(d), k, r, p, binning, binning, region)
    path.write_text(format_camera_info(info, "stereo/left", "one\nand another"))
    assert same(read_camera_info_file(path), info)


def test_the_keys_are_those_of_camera_info_manager():
    """In its order, and nothing else where binning and region, of which it knows nothing, are zero."""
    left, _ = PlainCameraInfo.of_rig(RIG)
    text = format_camera_info(left, "stereo/left", "\x1b]0;evil\x07")
    document, written = yaml.safe_load(text), yaml.safe_load(OF_CAMERA_CALIBRATION)
    assert sorted(document) == sorted(written)
    for key, value in written.items():
        if isinstance(value, dict):
            assert sorted(document[key]) == ["cols", "data", "rows"]
            assert (document[key]["rows"], document[key]["cols"]) == (value["rows"], value["cols"])
            assert len(document[key]["data"]) == value["rows"] * value["cols"]
            assert all(type(number) is float for number in document[key]["data"])
    assert "\x1b" not in text and text.count("\n#") == 1


def test_a_file_of_camera_calibration_is_read(tmp_path):
    path = tmp_path / "right.yaml"
    path.write_text(OF_CAMERA_CALIBRATION)
    info = read_camera_info_file(path)
    assert (info.width, info.height, info.distortion_model) == (640, 480, "plumb_bob")
    assert info.d.tolist() == [-0.31, 0.1, 1e-05, -0.0007, 0.0]
    assert (info.k[0], info.r[1], info.p[3]) == (517.83, 0.00551, -74.2)
    assert not is_ours(path) and is_ours(tmp_path / "none.yaml")


@pytest.mark.parametrize(
    ("pattern", "by", "why"),
    [
        (r"image_width: 640", "image_width: 0", "image_width is 0, a whole number from 1 on"),
        (r"image_width: 640", "image_width: 6.4", "image_width is 6.4, a whole number"),
        (r"image_width: 640\n", "", "image_width is 0"),
        (r"distortion_model: plumb_bob", "distortion_model: 5", "distortion_model is 5, a name"),
        (r"camera_matrix:", "camera_matrices:", "it has no camera_matrix with rows, cols and data"),
        (r",  -74.2", "", "projection_matrix has 11 values, 12 are needed"),
        (r"501.2, 0.     ", "501.2, many", "projection_matrix holds 'many', numbers are needed"),
        (r"data: \[-0.31, ", f"data: [{'0, ' * 11}", "distortion_coefficients has 15 values, at most 14"),
        (r"image_height: 480", "image_height: [", "is not YAML"),
        (r"image_height: 480", "image_width: 480", "'image_width' is there twice"),
    ],
)
def test_a_file_that_cannot_be_right_is_refused_with_its_name(tmp_path, pattern, by, why):
    path = tmp_path / "right.yaml"
    path.write_text(re.sub(pattern, by, OF_CAMERA_CALIBRATION, count=1))
    with pytest.raises(RigError, match=rf"CameraInfo file .*right\.yaml: .*{why}"):
        read_camera_info_file(path)


@pytest.mark.parametrize("content", [None, b"", b"- 1\n- 2\n", b"\xff\xfe\x00", b"x" * 100_000])
def test_any_other_file_is_refused_in_one_line(tmp_path, content):
    path = tmp_path / "left.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(RigError) as caught:
        read_camera_info_file(path)
    assert "left.yaml" in str(caught.value) and "\n" not in str(caught.value)


def test_a_corrected_pair_is_exported_with_the_original_beside_it(tmp_path):
    originals = PlainCameraInfo.of_rig(RIG)
    pair = repair_camera_info(*originals, TURNED)
    paths = write_exports(tmp_path / "out.yaml", [CAMERA_INFO], None, RIG, [pair], "front")
    assert sorted(path.name for path in paths) == [
        "out.left.yaml",
        "out.left_original.yaml",
        "out.right.yaml",
        "out.right_original.yaml",
    ]
    assert set(paths) <= set(export_paths(tmp_path / "out.yaml", [CAMERA_INFO]))
    for name, info in zip(
        ("left", "right", "left_original", "right_original"), (pair.left, pair.right, *originals), strict=True
    ):
        assert same(read_camera_info_file(tmp_path / f"out.{name}.yaml"), info), name
    right = (tmp_path / "out.right.yaml").read_text()
    assert "# the right camera is turned back in pitch, roll, yaw (pitch +0.115 deg (std 0.006)" in right
    assert yaml.safe_load(right)["camera_name"] == "front/right"
    # Once more: what was written here may be replaced.
    assert write_exports(tmp_path / "out.yaml", [CAMERA_INFO], None, RIG, [pair], "front") == paths


@pytest.mark.parametrize("name", ["out.left.yaml", "out.right_original.yaml"])
def test_a_camera_info_file_of_somebody_else_is_not_replaced(tmp_path, name):
    (tmp_path / name).write_text(OF_CAMERA_CALIBRATION)
    pairs = [repair_camera_info(*PlainCameraInfo.of_rig(RIG), TURNED)]
    with pytest.raises(OutputError, match=rf"{re.escape(name)} is not replaced: .*move it away"):
        write_exports(tmp_path / "out.yaml", ["urdf", CAMERA_INFO], PLACED, RIG, pairs, "front")
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == OF_CAMERA_CALIBRATION


def raw_pair(tmp_path):
    right = tmp_path / "raw.yaml"
    right.write_text(OF_CAMERA_CALIBRATION)
    info = read_camera_info_file(right)
    p = info.p.copy()
    p[3] = 0.0
    return replace(info, p=p), info


def test_the_driver_of_raw_cameras_gets_a_pair_of_its_own(tmp_path):
    """K = P and D = 0 would end the rectification of its images."""
    left, right = raw_pair(tmp_path)
    cameras = StereoRectifier.from_camera_info(left, right)
    pairs = repaired_pairs(cameras, TURNED)
    assert [pair.rectified for pair in pairs] == [True, False]
    texts = camera_infos(pairs, "front")
    assert sorted(texts) == sorted(
        f".{side}{what}.yaml" for side in ("left", "right") for what in ("", "_original", "_raw")
    )
    driver = yaml.safe_load(texts[".right_raw.yaml"])
    assert driver["distortion_coefficients"]["data"] == right.d.tolist()
    assert driver["camera_matrix"]["data"] == right.k.tolist()
    expected = TURNED.left_from_right @ right.r.reshape(3, 3)
    np.testing.assert_allclose(driver["rectification_matrix"]["data"], expected.ravel(), atol=1e-12)
    assert "for its raw images" in texts[".right_raw.yaml"]
    assert yaml.safe_load(texts[".left_raw.yaml"])["camera_matrix"]["data"] == left.k.tolist()
    # As raw images themselves they need no second pair, and what is not corrected none either.
    raw = StereoRectifier.from_camera_info(left, right, rectified=False)
    assert [pair.rectified for pair in repaired_pairs(raw, TURNED)] == [False]
    assert len(repaired_pairs(cameras, None)) == 1
    assert len(repaired_pairs(StereoRectifier.of_rig(RIG), TURNED)) == 1
