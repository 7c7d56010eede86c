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

"""replay: several bags, stretches, every pair, folders of images, CSV, damage in the middle."""

import csv
import io
import json
import math

import cv2
import pytest
import yaml
from bag_making import RIG, Camera, cameras, make_bag, picture
from fake_calibrator import use_fake

from stereo_selfcal.bags import part as part_module
from stereo_selfcal.bags import reader as reader_module
from stereo_selfcal.cli.replay import main
from stereo_selfcal.core.errors import ImageError, OutputError
from stereo_selfcal.core.evidence.gates import GATES


@pytest.fixture
def calibrator(monkeypatch):
    return use_fake(monkeypatch)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return make_bag(tmp_path_factory.mktemp("replay") / "bag", cameras(), n_frames=10)


def as_json(capsys, *arguments, status=0):
    assert main([*map(str, arguments), "--json"]) == status
    return json.loads(capsys.readouterr().out)


def stamps(content):
    return [round(frame["stamp_s"] * 10) - 1000 for frame in content["frames"]]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--start", "0.7"], [7, 8, 9]),
        (["--end", "0.2"], [0, 1]),
        (["--start", "0.2", "--end", "0.9", "--every", "3"], [2, 5, 8]),
        (["--every", "4", "--max-frames", "2"], [0, 4]),
    ],
)
def test_stretches(bag, calibrator, capsys, options, expected):
    assert stamps(as_json(capsys, bag, *options)) == expected


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--start", "2"], "no frame between 2 s and its end after its start; the recording is 0.9 s long"),
        (["--start", "1", "--end", "1"], "the first must be the smaller"),
        (["--start", "-1"], "-1.0 is not a time in 0 ... 1000000000 s"),
        (["--end", "1e308"], "1e+308 is not a time"),
        (["--start", "nan"], "nan is not a time"),
        (["--approximate-sync-tolerance", "inf"], "inf is not a time"),
        (["--max-frames", "9" * 30], "is not in 1 ... 1000000000"),
        (["--every", "0"], "0 is not in 1 ... 1000000000"),
        (["--jobs", "0"], "0 is not in 1 ... "),
        (["--all", "--left", "/x"], "does not go with --left"),
        (["--csv", "x.yaml", "--output", "x.yaml"], "give two files"),
        (["--csv", "/nowhere/x.csv"], "--csv /nowhere/x.csv cannot be written"),
    ],
)
def test_what_cannot_be_done_is_one_line(bag, calibrator, capsys, tmp_path, monkeypatch, options, message):
    monkeypatch.chdir(tmp_path)
    assert main([str(bag), *options]) == 2
    err = capsys.readouterr().err
    assert message in err
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_several_bags_are_one_drive(bag, calibrator, capsys, tmp_path):
    more = make_bag(tmp_path / "more", cameras(), kind="ros1", first=10)
    output = tmp_path / "result.yaml"
    content = as_json(capsys, more, bag, "--output", output)
    assert stamps(content) == list(range(13))
    provenance = yaml.safe_load(output.read_text())["/**"]["ros__parameters"]["provenance"]
    assert provenance["source"] == "more.bag bag"


def several_pairs(tmp_path, rear_info=None):
    sides = [
        Camera(side, f"/{where}/{side}/image_rect", f"/{where}/{side}/camera_info")
        for where in ("front", "rear")
        for side in ("left", "right")
    ]
    if rear_info is not None:
        sides[2].info = sides[3].info = rear_info
    return make_bag(tmp_path / "bag", sides, n_frames=2)


def test_every_pair(calibrator, capsys, tmp_path):
    path = several_pairs(tmp_path)
    alone = as_json(capsys, path, "--left", "/rear/left/image_rect", "--right", "/rear/right/image_rect")
    files = ["--output", tmp_path / "out.yaml", "--csv", tmp_path / "rows.csv"]
    content = as_json(capsys, path, "--all", *files)
    assert list(content) == ["pairs"]
    assert [pair["name"] for pair in content["pairs"]] == ["front", "rear"]
    rear = content["pairs"][1]
    assert rear == {
        "name": "rear",
        "left": "/rear/left/image_rect",
        "right": "/rear/right/image_rect",
        **alone,
    }
    names = {"out.front.yaml", "out.rear.yaml", "rows.front.csv", "rows.rear.csv", "bag"}
    assert {file.name for file in tmp_path.iterdir()} == names
    assert main([str(path), "--all"]) == 0
    out = capsys.readouterr().out
    assert out.count("2 of 2 frames accepted") == 2
    assert out.index("/front/left") < out.index("/rear/left")


def test_a_pair_that_fails_does_not_end_the_others(calibrator, capsys, tmp_path):
    path = several_pairs(tmp_path, rear_info="")
    assert main([str(path), "--all", "--json"]) == 2
    out, err = capsys.readouterr()
    front, rear = json.loads(out)["pairs"]
    assert front["accepted"]
    assert not rear["accepted"]
    assert "no CameraInfo" in rear["error"]
    assert err.startswith("replay: rear: ")
    assert err.count("\n") == 1


def test_a_pair_that_is_not_accepted_is_status_1(calibrator, capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(calibrator, "accept", lambda self, index: len(calibrator.made) != 1)
    content = as_json(capsys, several_pairs(tmp_path), "--all", status=1)
    assert [pair["accepted"] for pair in content["pairs"]] == [False, True]


def test_pairs_without_a_name_of_their_own_are_numbered(calibrator, capsys, tmp_path):
    sides = [Camera(side, f"/{side}_{lens}", "") for lens in ("a", "b") for side in ("left", "right")]
    rig = tmp_path / "rig.yaml"
    rig.write_text(yaml.safe_dump(RIG.to_mapping()))
    content = as_json(capsys, make_bag(tmp_path / "bag", sides), "--all", "--rig", rig)
    assert [pair["name"] for pair in content["pairs"]] == ["pair1", "pair2"]


def image_folder(folder, names, suffix=".png", sides=("left", "right"), rig=True):
    for side, of in zip(sides, ("left", "right"), strict=True):
        (folder / side).mkdir(parents=True)
        for index, name in enumerate(names):
            cv2.imwrite(str(folder / side / f"{name}{suffix}"), picture(of, index))
    if rig:
        (folder / "rig.yaml").write_text(yaml.safe_dump(RIG.to_mapping()))
    return folder


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".pgm", ".TIF"])
def test_a_folder_of_image_pairs(calibrator, capsys, tmp_path, suffix):
    folder = image_folder(tmp_path / "images", ["000007", "000003", "000020"], suffix)
    content = as_json(capsys, folder)
    assert [frame["name"] for frame in content["frames"]] == [
        f"{n}{suffix}" for n in ("000003", "000007", "000020")
    ]
    assert [frame["stamp_s"] for frame in content["frames"]] == [0.0, 0.1, 0.2]
    assert calibrator.made[0].rig == RIG
    assert main([str(folder), "--every", "2", "--picture", str(tmp_path / "p.png")]) == 0
    out = capsys.readouterr().out
    assert out.startswith(
        "left  left (3 images)\nright right (3 images)\nthe names of the images are no stamps"
    )
    assert f"000020{suffix}  accepted" in out


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["1403636579763555584", "1403636579813555456"], [1403636579.763555584, 1403636579.813555456]),
        (["100.25", "99.5"], [99.5, 100.25]),
        (["99.5", "frame"], [0.0, 0.1]),
    ],
)
def test_stamps_in_the_names(calibrator, capsys, tmp_path, names, expected):
    content = as_json(capsys, image_folder(tmp_path / "images", names))
    assert [frame["stamp_s"] for frame in content["frames"]] == expected


def test_folders_of_other_names_and_a_rig_file(calibrator, capsys, tmp_path):
    folder = image_folder(tmp_path / "images", ["0"], sides=("image_0", "image_1"), rig=False)
    chosen = [str(folder), "--left", "image_0", "--right", "image_1"]
    assert main(chosen) == 2
    assert "images carry no rig: give --rig, or put rig.yaml" in capsys.readouterr().err
    rig = tmp_path / "rig.yaml"
    rig.write_text(yaml.safe_dump(RIG.to_mapping()))
    assert len(as_json(capsys, *chosen, "--rig", rig)["frames"]) == 1
    assert main([str(folder), "--rig", str(rig)]) == 2
    assert "in left and right or the folders of --left and --right" in capsys.readouterr().err


def test_folders_without_a_common_name(calibrator, capsys, tmp_path):
    folder = image_folder(tmp_path / "images", ["a"])
    (folder / "left" / "a.png").rename(folder / "left" / "b.png")
    assert main([str(folder)]) == 2
    assert "no image of left has the name of one of right (b ...; a ...)" in capsys.readouterr().err


def test_an_image_that_is_none_is_a_refused_frame(calibrator, capsys, tmp_path):
    folder = image_folder(tmp_path / "images", ["0", "1", "2"])
    (folder / "left" / "1.png").write_bytes(b"no image")
    content = as_json(capsys, folder)
    assert [frame["reason"] for frame in content["frames"]] == [None, "image_unreadable", None]
    for name in ("0", "2"):
        (folder / "left" / f"{name}.png").write_bytes(b"no image")
    assert main([str(folder)]) == 2
    assert "cannot be decoded" in capsys.readouterr().err


def test_a_folder_of_images_is_given_alone(bag, calibrator, capsys, tmp_path):
    assert main([str(image_folder(tmp_path / "images", ["0"])), str(bag)]) == 2
    assert "give it alone" in capsys.readouterr().err


def test_csv_has_a_line_per_frame_with_every_digit(bag, calibrator, monkeypatch, tmp_path):
    monkeypatch.setattr(calibrator, "accept", staticmethod(lambda index: index != 1))
    path = tmp_path / "rows.csv"
    assert main([str(bag), "--csv", str(path)]) == 0
    rows = list(csv.DictReader(io.StringIO(path.read_text())))
    assert len(rows) == 10
    assert (rows[0]["accepted"], rows[0]["reason"], float(rows[0]["pitch_rad"])) == ("1", "", 0.05)
    assert float(rows[0]["height_std_m"]) == math.sqrt(1e-6)
    assert (rows[1]["accepted"], rows[1]["reason"], rows[1]["height_m"]) == ("0", "no_lines_found", "")
    assert rows[1]["message"] == "lines found: 0, at least 2 needed; paint some"
    assert {f"gate_{gate.key}" for gate in GATES} <= rows[0].keys()


def test_an_image_that_cannot_be_converted_is_a_refused_frame(bag, calibrator, monkeypatch, capsys):
    convert = reader_module.message_to_grey

    def message_to_grey(message, rig_size):
        if message.header.stamp.nanosec == 300_000_000:
            raise ImageError("cut short")
        return convert(message, rig_size)

    monkeypatch.setattr(reader_module, "message_to_grey", message_to_grey)
    assert main([str(bag)]) == 0
    out = capsys.readouterr().out
    assert "100.300000  image_unreadable" in out
    assert "1 x image_unreadable" in out


@pytest.fixture
def cut_off(bag, monkeypatch):
    """A recording that ends in damage after four frames."""
    inner = part_module.Part.messages

    def messages(self, topics, *stretch):
        for message in inner(self, topics, *stretch):
            if message.topic.endswith("image_rect") and message.content.header.stamp.nanosec == 400_000_000:
                with self._damage_reported():
                    raise ValueError("Chunk checksum mismatch")
            yield message

    monkeypatch.setattr(part_module.Part, "messages", messages)
    return bag


def test_damage_after_some_frames_is_said_everywhere(cut_off, calibrator, capsys, tmp_path):
    output, rows = tmp_path / "result.yaml", tmp_path / "rows.csv"
    output.write_text("an older result")
    arguments = [str(cut_off), "--output", str(output), "--csv", str(rows)]
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert "4 of 4 frames accepted" in out
    assert out.endswith("THE RECORDING IS DAMAGED AND ENDED EARLY, after 4 frames\n")
    assert err.count("\n") == 1
    assert "Chunk checksum mismatch" in err
    assert "ended early, after 4 frames: --max-frames 4 calibrates from these alone" in err
    assert output.read_text() == "an older result"
    assert len(rows.read_text().splitlines()) == 5
    content = as_json(capsys, cut_off, status=2)
    assert content["accepted"]
    assert "ended early, after 4 frames" in content["ended_early"]
    content = as_json(capsys, cut_off, "--max-frames", 4, "--output", output)
    assert "ended_early" not in content
    assert "provenance" in output.read_text()


@pytest.mark.parametrize("json_wanted", [False, True])
def test_a_file_that_cannot_be_written_costs_neither_the_others_nor_the_numbers(
    bag, calibrator, capsys, tmp_path, monkeypatch, json_wanted
):
    def fill(path, content):
        if path.suffix in (".csv", ".yaml"):
            raise OutputError(f"{path} cannot be written: no space left on device; make room")
        path.write_bytes(content)

    monkeypatch.setattr("stereo_selfcal.cli.replay.write_atomically", fill)
    monkeypatch.setattr("stereo_selfcal.files.result_file.write_atomically", fill)
    options = [f"--{kind}={tmp_path / name}" for kind, name in OUTPUTS.items()]
    assert main([str(bag), *options, *(["--json"] if json_wanted else [])]) == 2
    out, err = capsys.readouterr()
    assert (json.loads(out)["accepted"]) if json_wanted else ("standard deviation of the mount" in out)
    assert [line.split(" cannot")[0].rpartition("/")[2] for line in err.splitlines()] == ["o.yaml", "o.csv"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["o.html", "o.png"]


OUTPUTS = {"output": "o.yaml", "csv": "o.csv", "picture": "o.png", "report": "o.html"}


@pytest.mark.parametrize("option", OUTPUTS)
def test_a_name_too_long_for_an_output_is_told_before_the_work(bag, calibrator, capsys, tmp_path, option):
    path = tmp_path / (300 * "n" + OUTPUTS[option])
    assert main([str(bag), f"--{option}", str(path)]) == 2
    out, err = capsys.readouterr()
    assert out == "" and f"replay: --{option} " in err and "choose a shorter name" in err
    assert calibrator.made == []


def test_a_recording_with_a_name_too_long_is_one_line(capsys, tmp_path):
    assert main([str(tmp_path / (300 * "n"))]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and "name too long" in err
