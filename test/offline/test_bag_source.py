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

"""Frames of bags as the calibrator gets them: rectified by CameraInfo, as in the node."""

import json

import numpy as np
import pytest
import yaml
from bag_making import RIG, Camera, cameras, make_bag, picture
from fake_calibrator import use_fake

from stereo_selfcal.bags import BagError, StereoBag, reader
from stereo_selfcal.cli.replay import main
from stereo_selfcal.core.camera.rectifier import StereoRectifier
from stereo_selfcal.offline import open_source

LENS = {"d": np.array([-0.2, 0.05, 0.001, -0.001, 0.0])}


def raw_cameras(**changes):
    return [
        Camera(side, f"/stereo/{side}/image_raw", info_changes=LENS | changes) for side in ("left", "right")
    ]


def test_rectified_images_stay_as_they_are(tmp_path):
    with open_source([make_bag(tmp_path / "bag", cameras())]) as source:
        for index, frame in enumerate(source.frames()):
            np.testing.assert_array_equal(frame.left, picture("left", index))
        assert source.rig == RIG
        assert source.remarks == ()


def test_raw_images_are_rectified(tmp_path):
    path = make_bag(tmp_path / "bag", raw_cameras())
    with StereoBag(path) as bag:
        rectifier = bag.follow_cameras(False)
    with open_source([path], raw=True) as source:
        assert source.rig == rectifier.rig
        for index, frame in enumerate(source.frames()):
            left, right = rectifier.apply(picture("left", index), picture("right", index))
            np.testing.assert_array_equal(frame.left, left)
            np.testing.assert_array_equal(frame.right, right)
            assert not np.array_equal(left, picture("left", index))
            np.testing.assert_array_equal(source.frame_at(frame.recorded_ns).left, left)


def test_a_fault_while_a_frame_is_decoded_or_rectified_refuses_that_frame(
    tmp_path, monkeypatch, capsys, caplog
):
    path = make_bag(tmp_path / "bag", raw_cameras(), n_frames=4)
    use_fake(monkeypatch)
    decode, rectify, calls = reader.message_to_grey, StereoRectifier.apply, []

    def decode_or_fail(*given):
        calls.append(given)
        if len(calls) == 3:  # the left image of the second frame
            raise KeyError("a bug")
        return decode(*given)

    def rectify_or_fail(self, left, right):
        if len(calls) == 7:  # the fourth frame: the third call of the second frame is missing
            raise ZeroDivisionError("another bug")
        return rectify(self, left, right)

    monkeypatch.setattr(reader, "message_to_grey", decode_or_fail)
    monkeypatch.setattr(StereoRectifier, "apply", rectify_or_fail)
    assert main([str(path), "--raw", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    reasons = [frame["reason"] for frame in content["frames"]]
    assert reasons == [None, "internal_error", None, "internal_error"]
    assert len(caplog.messages) == 2
    assert "KeyError: 'a bug' (test_bag_source.py" in caplog.messages[0]
    assert "Traceback" in caplog.messages[1] and "rectify_or_fail" in caplog.messages[1]


def test_raw_topics_are_found_beside_rectified_ones(tmp_path):
    path = make_bag(
        tmp_path / "bag", [*raw_cameras(), *(Camera(side, info="") for side in ("left", "right"))]
    )
    for raw, leaf in ((False, "image_rect"), (True, "image_raw")):
        with open_source([path], raw=raw) as source:
            assert (source.left_name, source.right_name) == (f"/stereo/left/{leaf}", f"/stereo/right/{leaf}")


def test_a_right_camera_with_another_principal_point_is_mended(tmp_path):
    other = [50.0, 0, 33.5, -50.0 * 0.15, 0, 50, 23.5, 0, 0, 0, 1, 0]
    sides = [Camera("left"), Camera("right", info_changes={"p": np.array(other)})]
    with open_source([make_bag(tmp_path / "bag", sides)]) as source:
        frame = next(iter(source.frames()))
    np.testing.assert_array_equal(frame.left, picture("left", 0))
    assert not np.array_equal(frame.right, picture("right", 0))


def test_raw_images_need_their_camera_info(tmp_path):
    path = make_bag(tmp_path / "bag", raw_cameras())
    with pytest.raises(BagError, match="a rig file describes rectified cameras"):
        open_source([path], rig=RIG, raw=True)
    wrong = make_bag(tmp_path / "wrong", raw_cameras(r=np.zeros(9)))
    with pytest.raises(BagError, match=r"wrong: left CameraInfo has no rotation.*left/camera_info"):
        open_source([wrong], raw=True)


def test_raw_on_the_command_line(tmp_path, monkeypatch, capsys):
    fake = use_fake(monkeypatch)
    path = make_bag(tmp_path / "bag", raw_cameras())
    assert main([str(path), "--raw", "--json"]) == 0
    assert "remarks" not in json.loads(capsys.readouterr().out)
    assert fake.made[0].rig == RIG
    rig = tmp_path / "rig.yaml"
    rig.write_text(yaml.safe_dump(RIG.to_mapping()))
    for arguments in (["--raw", "--rig", str(rig)], ["--raw", "--all", "--rig", str(rig)]):
        assert main([str(path), *arguments]) == 2
        assert "rectified cameras" in capsys.readouterr().err
