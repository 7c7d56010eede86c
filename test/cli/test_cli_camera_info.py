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

"""A rig whose right camera has turned: exported, and the same recording replayed with what was exported."""

import json
import math
import re
from functools import partial

import cv2
import numpy as np
import pytest
import yaml
from bag_making import RIG, cameras, make_bag, picture
from camera_making import make_road_bag
from fake_calibrator import use_fake
from independent_camera import OPTICAL_FROM_BODY, turn
from independent_lens import raw_image

from stereo_selfcal.bags import BagError
from stereo_selfcal.cli import replay
from stereo_selfcal.core.camera.plain_camera_info import PlainCameraInfo
from stereo_selfcal.core.camera.rectifier import StereoRectifier
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.core.geometry.camera_info_repair import repair_camera_info, repaired_pairs
from stereo_selfcal.files.camera_info_file import format_camera_info, read_camera_info_file
from stereo_selfcal.offline import open_source
from stereo_selfcal.synth.scenes import PAPER_RIG

PITCH, ROLL, YAW = np.radians([0.1, 0.2, 0.1])
TURNED = Alignment(PITCH, ROLL, YAW, np.diag(np.radians([0.005, 0.01, 0.01]) ** 2))
# So much that it shows in the small images of RIG.
FAR_TURNED = Alignment(*np.radians([1.0, 2.0, 2.0]), np.eye(3) * 1e-8)


def as_turned(rig, side, pixels):
    """Return the image that a turned right camera takes, by turns of its body about single axes."""
    if side == "left":
        return pixels
    body = turn("z", YAW) @ turn("y", PITCH) @ turn("x", ROLL)
    info = PlainCameraInfo.of_rig(rig)[1].rectified(OPTICAL_FROM_BODY @ body @ OPTICAL_FROM_BODY.T)
    return raw_image(info, pixels)


def export_as_measured(monkeypatch, alignment):
    """Let replay export as if that alignment had been measured."""
    monkeypatch.setattr(replay, "repaired_pairs", lambda cameras, _: repaired_pairs(cameras, alignment))


def run(*arguments):
    return replay.main([str(each) for each in (*arguments, "--jobs", 1)])


def write_pair(folder, pair, names=("l.yaml", "r.yaml")):
    files = [folder / name for name in names]
    for file, info in zip(files, (pair.left, pair.right), strict=True):
        file.write_text(format_camera_info(info, "cam", ""))
    return files


@pytest.mark.slow
def test_a_turned_camera_is_exported_and_the_same_recording_is_right_with_it(tmp_path, monkeypatch, capsys):
    bag = make_road_bag(tmp_path / "bag", 2)
    turned = make_road_bag(tmp_path / "turned", 2, seen=partial(as_turned, PAPER_RIG))
    # The CameraInfo alone puts it right, and not what is measured of the turn in each frame.
    config = tmp_path / "config.yaml"
    config.write_text("/**: {ros__parameters: {alignment: {correct: none}}}")
    assert run(bag, "--json", "--config", config) == 0
    expected = json.loads(capsys.readouterr().out)["extrinsics"]

    export_as_measured(monkeypatch, TURNED)
    out = tmp_path / "out.yaml"
    # Whatever becomes of the turned frames, the recording that is right is exported as if it were turned.
    assert run(bag, "--output", out, "--export", "camera_info") == 0
    text = capsys.readouterr().out
    assert "CameraInfo: the right camera is turned back in pitch, roll, yaw (pitch +0.100 deg" in text
    assert text.index("CameraInfo: ") > text.index("calibrated from 2 frames")
    files = tmp_path / "out.left.yaml", tmp_path / "out.right.yaml"
    assert run(turned, "--camera-info", *files, "--json", "--config", config) == 0
    found = json.loads(capsys.readouterr().out)["extrinsics"]
    # Of an image that is interpolated twice: a hundredth of a pixel is 0.5 mm of height at these cameras.
    assert found["height_m"] == pytest.approx(expected["height_m"], abs=3e-3)
    assert found["pitch_rad"] == pytest.approx(expected["pitch_rad"], abs=math.radians(0.02))
    assert found["roll_rad"] == pytest.approx(expected["roll_rad"], abs=math.radians(0.1))
    originals = [file.with_stem(f"{file.stem}_original") for file in files]
    run(turned, "--camera-info", *originals, "--json", "--config", config)
    wrong = json.loads(capsys.readouterr().out)["extrinsics"]
    assert wrong is None or abs(wrong["pitch_rad"] - expected["pitch_rad"]) > math.radians(0.2)


@pytest.mark.parametrize("kind", ["bag", "folder"])
def test_images_are_turned_by_the_files_in_bags_and_folders(tmp_path, kind):
    pair = repair_camera_info(*PlainCameraInfo.of_rig(RIG), FAR_TURNED)
    files = write_pair(tmp_path, pair)
    path = tmp_path / "drive"
    if kind == "bag":
        make_bag(path, cameras(), n_frames=2)
    else:
        for side in ("left", "right"):
            (path / side).mkdir(parents=True)
            for index in range(2):
                cv2.imwrite(str(path / side / f"{index}.png"), picture(side, index))
    rectifier = StereoRectifier.from_camera_info(pair.left, pair.right)
    with open_source([path], camera_info=tuple(files)) as source:
        assert source.rig == RIG
        assert re.search(r"R turns the right images by 2\.98\d* deg", " ".join(source.notes))
        for index, frame in enumerate(source.frames()):
            _, right = rectifier.apply(picture("left", index), picture("right", index))
            np.testing.assert_array_equal(frame.left, picture("left", index))
            np.testing.assert_array_equal(frame.right, right)
            assert not np.array_equal(right, picture("right", index))
            assert frame.cameras is not None and frame.cameras.turned
            np.testing.assert_array_equal(source.frame_at(frame.recorded_ns).right, right)


def test_a_corrected_camera_info_in_the_recording_is_used_as_well(tmp_path):
    """Also one that comes in the middle: a change of the cameras, told with R."""
    pair = repair_camera_info(*PlainCameraInfo.of_rig(RIG), FAR_TURNED)
    both = cameras()
    both[1].info_of = lambda index: {"r": pair.right.r} if index >= 2 else {}
    path = make_bag(tmp_path / "bag", both, n_frames=4)
    rectifier = StereoRectifier.from_camera_info(pair.left, pair.right)
    with open_source([path]) as source:
        for index, frame in enumerate(source.frames()):
            expected = rectifier.apply(frame.left, picture("right", index))[1]
            np.testing.assert_array_equal(frame.right, expected if index >= 2 else picture("right", index))


def test_a_change_to_a_corrected_camera_info_begins_anew_and_says_so(tmp_path, capsys):
    pair = repair_camera_info(*PlainCameraInfo.of_rig(RIG), FAR_TURNED)
    both = cameras()
    both[1].info_of = lambda index: {"r": pair.right.r} if index >= 2 else {}
    assert run(make_bag(tmp_path / "bag", both, n_frames=4)) == 1  # no road is in these images
    out = capsys.readouterr().out
    assert "CameraInfo changed" in out and "R that is applied of the right camera none -> (" in out


def test_raw_images_get_k_d_r_and_p_of_the_files(tmp_path):
    lens = {"d": np.array([-0.2, 0.05, 0.001, -0.001, 0.0])}
    both = cameras()
    for camera in both:
        camera.image = f"/stereo/{camera.side}/image_raw"
    path = make_bag(tmp_path / "bag", both, n_frames=1)
    left, right = StereoRectifier.of_rig(RIG).infos
    originals = [type(each)(**{**fields(each), **lens}) for each in (left, right)]
    pair = repair_camera_info(*originals, TURNED, rectified=False)
    files = write_pair(tmp_path, pair)
    with open_source([path], raw=True, camera_info=tuple(files)) as source:
        (frame,) = source.frames()
    rectifier = StereoRectifier.from_camera_info(pair.left, pair.right, rectified=False)
    expected = rectifier.apply(picture("left", 0), picture("right", 0))
    np.testing.assert_array_equal(frame.left, expected[0])
    np.testing.assert_array_equal(frame.right, expected[1])
    with pytest.raises(BagError, match=r"is not called rectified.*give --raw.*CameraInfo of .*l\.yaml and "):
        open_source(
            [path], left="/stereo/left/image_raw", right="/stereo/right/image_raw", camera_info=tuple(files)
        )


def fields(info):
    return {name: getattr(info, name) for name in info.__slots__}


def test_without_a_measured_alignment_the_camera_info_is_exported_as_it_is(tmp_path, monkeypatch, capsys):
    use_fake(monkeypatch)
    export_as_measured(monkeypatch, None)
    lens = {"d": np.array([-0.2, 0.05, 0.001, -0.001, 0.0])}
    bag = make_bag(tmp_path / "bag", cameras(info_changes=lens), n_frames=2)
    assert run(bag, "--output", tmp_path / "out.yaml", "--export", "camera_info") == 0
    assert "CameraInfo: as it was: the alignment of the cameras was not measured" in capsys.readouterr().out
    names = ("left", "right", "left_original", "right_original")
    assert sorted(path.name for path in tmp_path.glob("out.*.yaml")) == sorted(f"out.{n}.yaml" for n in names)
    for name in names:
        info = read_camera_info_file(tmp_path / f"out.{name}.yaml")
        assert info.d.tolist() == lens["d"].tolist() and info.r.tolist() == np.eye(3).ravel().tolist()
        assert info.p[3] == pytest.approx(-RIG.fx * RIG.baseline_m if name.startswith("right") else 0.0)


def test_a_folder_of_images_is_exported_with_its_rig(tmp_path, monkeypatch, capsys):
    use_fake(monkeypatch)
    export_as_measured(monkeypatch, TURNED)
    drive = tmp_path / "drive"
    for side in ("left", "right"):
        (drive / side).mkdir(parents=True)
        cv2.imwrite(str(drive / side / "1.png"), picture(side, 1))
    (drive / "rig.yaml").write_text(yaml.safe_dump(RIG.to_mapping()))
    assert run(drive, "--output", tmp_path / "out.yaml", "--export", "camera_info", "--json") == 0
    assert "CameraInfo" not in capsys.readouterr().out
    files = tmp_path / "out.left.yaml", tmp_path / "out.right.yaml"
    assert run(drive, "--camera-info", *files) == 0
    assert "R turns the right images by 0.245 deg" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--rig", "rig.yaml"], "the rig is given by --rig and by --camera-info"),
        (["--left-info", "/a", "--right-info", "/b"], "by --camera-info and by the CameraInfo topics"),
        (["--all"], "it does not go with .*--camera-info"),
        (["--output", "r.yaml"], "--output .*r.yaml is --camera-info .*r.yaml, which is read"),
    ],
)
def test_what_does_not_go_with_camera_info_files_is_refused(tmp_path, monkeypatch, capsys, arguments, why):
    use_fake(monkeypatch)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(RIG.to_mapping()))
    files = write_pair(tmp_path, repair_camera_info(*PlainCameraInfo.of_rig(RIG), TURNED))
    bag = make_bag(tmp_path / "bag", cameras(), n_frames=2)
    assert run(bag, "--camera-info", *files, *arguments) == 2
    assert_said(capsys, why)


def test_a_file_that_cannot_be_right_is_told_in_one_line(tmp_path, capsys):
    bag = make_bag(tmp_path / "bag", cameras(), n_frames=2)
    files = write_pair(tmp_path, repair_camera_info(*PlainCameraInfo.of_rig(RIG), TURNED))
    assert run(bag, "--camera-info", files[1], files[0]) == 2
    assert_said(capsys, "negative baseline .*CameraInfo of .*r.yaml and .*l.yaml")
    files[1].write_text("image_width: 5")
    assert run(bag, "--camera-info", *files) == 2
    assert_said(capsys, "CameraInfo file .*r.yaml: image_height is 0")


def assert_said(capsys, pattern):
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    assert re.search(pattern, err), err


@pytest.mark.parametrize(("alignment", "written"), [(TURNED, 4), (None, 0)])
def test_without_an_accepted_frame_a_corrected_camera_info_is_exported(
    tmp_path, monkeypatch, capsys, alignment, written
):
    monkeypatch.setattr(use_fake(monkeypatch), "accept", staticmethod(lambda index: False))
    export_as_measured(monkeypatch, alignment)
    bag = make_bag(tmp_path / "bag", cameras(), n_frames=1)
    assert run(bag, "--output", tmp_path / "out.yaml", "--export", "camera_info,urdf") == 1
    assert ("CameraInfo: the right camera is turned back" in capsys.readouterr().out) == bool(written)
    assert not (tmp_path / "out.yaml").exists() and not (tmp_path / "out.urdf.xml").exists()
    assert len(list(tmp_path.glob("out.*.yaml"))) == written
