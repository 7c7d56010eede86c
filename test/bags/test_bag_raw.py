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

"""Recordings of raw images, and of rectified ones whose right camera has another cx."""

from dataclasses import replace

import numpy as np
import pytest
from bag_making import RIG, Camera, cameras, make_bag, picture

from stereo_selfcal.bags import BagError, StereoBag
from stereo_selfcal.bags.topics import find_stereo_topics
from stereo_selfcal.cli.replay import main
from stereo_selfcal.core.config import CalibratorConfig
from stereo_selfcal.fleet.work import FleetSettings
from stereo_selfcal.offline import open_source


def raw_cameras(**both):
    """Return cameras whose raw principal point lies 4 columns and 2 rows beside that of P."""
    k = np.array([RIG.fx, 0, RIG.cx + 4, 0, RIG.fy, RIG.cy + 2, 0, 0, 1.0])
    return [
        Camera(side, image=f"/stereo/{side}/image_raw", info_changes={"k": k, **both})
        for side in ("left", "right")
    ]


def test_raw_images_are_rectified(tmp_path):
    path = make_bag(tmp_path / "bag", raw_cameras())
    with open_source([path], raw=True) as source:
        assert source.left_name == "/stereo/left/image_raw"
        assert source.rig.to_mapping() == pytest.approx(RIG.to_mapping())
        frames = list(source.frames())
        again = source.frame_at(frames[1].recorded_ns)
    assert len(frames) == 3
    for index, frame in enumerate(frames):
        for side in ("left", "right"):
            expected = picture(side, index)[2:, 4:]
            np.testing.assert_array_equal(getattr(frame, side)[:-2, :-4], expected)
    np.testing.assert_array_equal(again.left, frames[1].left)


def test_rectified_images_with_another_cx_are_shifted(tmp_path):
    p = np.array([RIG.fx, 0, RIG.cx - 3, -RIG.fx * RIG.baseline_m, 0, RIG.fy, RIG.cy, 0, 0, 0, 1.0, 0])
    pair = [Camera("left"), Camera("right", info_changes={"p": p})]
    with open_source([make_bag(tmp_path / "bag", pair)]) as source:
        frame = next(source.frames())
    np.testing.assert_array_equal(frame.left, picture("left", 0))
    np.testing.assert_array_equal(frame.right[:, 3:], picture("right", 0)[:, :-3])


def test_without_its_camera_info_a_bag_gives_images_as_they_are(tmp_path):
    with StereoBag(make_bag(tmp_path / "bag", raw_cameras()), raw=True) as bag:
        np.testing.assert_array_equal(next(bag.frames()).left, picture("left", 0))


def test_raw_topics_are_preferred_when_they_are_wanted(tmp_path):
    raw_ones = [Camera(side, f"/stereo/{side}/image_raw", info="") for side in ("left", "right")]
    path = make_bag(tmp_path / "bag", [*cameras(), *raw_ones])
    for raw, name in ((False, "/stereo/left/image_rect"), (True, "/stereo/left/image_raw")):
        with StereoBag(path, raw=raw) as bag:
            assert bag.topics.left.name == name
            found = find_stereo_topics([bag.topics.left, bag.topics.right], raw=raw)
            assert found.left.name == name


def test_doubts_about_the_camera_info_are_remarks(tmp_path):
    path = make_bag(tmp_path / "bag", raw_cameras(d=np.array([0.1, 0, 0, 0, 0])))
    with open_source([path], raw=True) as source:
        assert source.remarks == ()
    k = np.array([RIG.fx * 3, 0, RIG.cx, 0, RIG.fy * 3, RIG.cy, 0, 0, 1.0])
    with open_source([make_bag(tmp_path / "other", cameras(info_changes={"k": k}))]) as source:
        assert len(source.remarks) == 2 and "different resolutions" in source.remarks[0]


def test_raw_images_and_a_rig_file_contradict_each_other(tmp_path):
    path = make_bag(tmp_path / "bag", raw_cameras())
    with pytest.raises(BagError, match="leave out --rig or --raw"):
        open_source([path], rig=RIG, raw=True)
    for side in ("left", "right"):
        (tmp_path / "images" / side).mkdir(parents=True)
    with pytest.raises(BagError, match="raw images need CameraInfo"):
        open_source([tmp_path / "images"], rig=RIG, raw=True)


def test_camera_info_that_cannot_be_right_ends_the_replay(tmp_path, capsys):
    path = make_bag(tmp_path / "bag", raw_cameras(d=np.zeros(3)))
    assert main([str(path), "--raw"]) == 2
    assert (
        "left CameraInfo has 3 distortion coefficients, plumb_bob has 0 or 4 or 5" in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    "changes",
    [{"d": np.array([0.1] * 3)}, {"k": np.zeros(9)}, {"p": np.zeros(12)}, {"r": np.zeros(9)}],
)
def test_raw_images_are_never_advised_to_take_a_rig_file(tmp_path, changes):
    """It would be refused, as it describes rectified cameras."""
    path = make_bag(tmp_path / "bag", raw_cameras(**changes))
    with pytest.raises(BagError) as error:
        open_source([path], raw=True)
    words = str(error.value)
    assert "--rig" not in words and "rig by parameters" not in words
    assert "/stereo/left/camera_info" in words


def test_raw_images_of_an_unknown_model_can_be_rectified_before(tmp_path):
    sides = raw_cameras(distortion_model="fov", d=np.array([0.9]))
    with pytest.raises(BagError, match=r"'fov', known are .* or rectify the images before") as error:
        open_source([make_bag(tmp_path / "bag", sides)], raw=True)
    assert "replay without --raw" in str(error.value) and "--rig" not in str(error.value)


def test_raw_images_that_are_taken_for_rectified_are_refused(tmp_path, capsys):
    path = make_bag(tmp_path / "bag", raw_cameras())
    assert main([str(path)]) == 2
    words = capsys.readouterr().err
    assert "/stereo/left/image_raw is not called rectified" in words and "(K is not P)" in words
    assert "moves pixels by up to 4.0 px, at most 0.1 px allowed" in words
    assert "give --raw, or --rectified if they are rectified after all" in words
    plain = make_bag(tmp_path / "plain", raw_cameras(k=np.array([50.0, 0, 31.5, 0, 50, 23.5, 0, 0, 1])))
    with open_source([plain]) as source:
        assert source.remarks == ()


def test_rectified_images_are_not_rectified_again(tmp_path):
    path = make_bag(tmp_path / "bag", cameras(info_changes={"d": np.array([-0.2, 0.05, 0, 0, 0])}))
    with pytest.raises(BagError, match=r"image_rect is called rectified.* leave out --raw"):
        open_source([path], raw=True)


def test_binning_of_images_that_are_not_binned_is_not_applied(tmp_path):
    path = make_bag(tmp_path / "bag", cameras(info_changes={"binning_x": 2, "binning_y": 2}))
    with open_source([path]) as source:
        frames = list(source.frames())
        assert [frame.cameras.rig for frame in frames] == [RIG] * 3
        assert any("images show the whole sensor" in remark for remark in source.remarks)


def test_images_that_are_declared_rectified_are_taken_so_with_a_remark(tmp_path, capsys):
    path = make_bag(tmp_path / "bag", raw_cameras(d=np.array([-0.2, 0.05, 0, 0, 0])))
    with open_source([path], rectified=True) as source:
        frame = next(source.frames())
        np.testing.assert_array_equal(frame.left, picture("left", 0))
        assert [remark.startswith("the images are taken as rectified") for remark in source.remarks] == [True]
    assert main([str(path), "--rectified"]) == 1, "read, and without lane lines"
    assert "the images are taken as rectified, as --rectified says" in capsys.readouterr().out
    assert main([str(path), "--rectified", "--raw"]) == 2
    assert "not allowed with argument --rectified" in capsys.readouterr().err


def test_nothing_is_remarked_where_the_topics_say_rectified_too(tmp_path):
    path = make_bag(tmp_path / "bag", cameras(info_changes={"d": np.array([-0.2, 0.05, 0, 0, 0])}))
    with open_source([path]) as plain, open_source([path], rectified=True) as source:
        assert source.remarks == plain.remarks


def test_a_fleet_takes_what_is_declared_rectified(tmp_path):
    path = make_bag(tmp_path / "bag", raw_cameras())
    plain = FleetSettings(CalibratorConfig())
    with pytest.raises(BagError, match="or --rectified if they are"):
        plain.open(path)
    declared = replace(plain, rectified=True)
    assert declared.to_mapping() != plain.to_mapping()
    with declared.open(path) as source:
        assert source.left_name == "/stereo/left/image_raw"
