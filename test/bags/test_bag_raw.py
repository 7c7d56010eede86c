"""Recordings of raw images, and of rectified ones whose right camera has another cx."""

import numpy as np
import pytest
from bag_making import RIG, Camera, cameras, make_bag, picture

from stereo_selfcal.bags import BagError, StereoBag
from stereo_selfcal.bags.topics import find_stereo_topics
from stereo_selfcal.cli.replay import main
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
