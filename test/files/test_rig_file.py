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

"""Rig files: whatever is in one, it is a rig or one clear error."""

import json
import os
import time

import pytest
import yaml
from bag_making import RIG

from stereo_selfcal.core.errors import RigError
from stereo_selfcal.files.rig_file import read_rig_file

VALUES = RIG.to_mapping()
BOMB = "a0: &a0 [lol, lol, lol]\n" + "".join(
    f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}, *a{i - 1}]\n" for i in range(1, 20)
)


def with_value(name, text, suffix=".yaml"):
    lines = [f'"{key}": {text if key == name else value}' for key, value in VALUES.items()]
    return suffix, f"{{{', '.join(lines)}}}"


UNUSABLE = {
    "deep YAML": (".yaml", "[" * 30_000, "recursion"),
    "deep JSON": (".json", "[" * 60_000, "recursion|larger|Recursion"),
    "bomb": (".yaml", BOMB, "aliases"),
    "alias": (".yaml", "width: &w 64\nheight: *w", "aliases"),
    "alias in itself": (".yaml", "&a [*a]", "aliases"),
    "digits": (*with_value("fx", "9" * 4000), "64 bits"),
    "more digits": (*with_value("fx", "9" * 5000), "digits"),
    "digits in JSON": (*with_value("fx", "9" * 4000, ".json"), "rig.fx is inf"),
    "more digits in JSON": (*with_value("fx", "9" * 5000, ".json"), "digits"),
    "huge": (".yaml", "#" * 70_000, "larger than 65536 bytes"),
    "huge JSON": (".json", " " * 70_000, "larger than 65536 bytes"),
    "empty": (".yaml", "", "holds no keys"),
    "empty JSON": (".json", "", "not JSON in line 1"),
    "list": (".yaml", "[1, 2]", "holds no keys"),
    "two documents": (".yaml", "width: 1\n---\nheight: 2", "second document in line 2"),
    "twice": (".yaml", "width: 1\nwidth: 2", "in line 2: 'width' is there twice"),
    "twice in JSON": (".json", '{"width": 1, "width": 2}', "'width' is there twice"),
    "object": (".yaml", "!!python/object:os.system {}", "could not determine a constructor"),
    "set": (".yaml", "!!set {width, height}", "holds no keys"),
    "no bool": (".yaml", "width: !!bool maybe", "cannot be read"),
    "no time": (".yaml", "width: !!timestamp soon", "cannot be read"),
    "no number": (".yaml", "width: !!int ''", "cannot be read"),
    "no fraction": (".yaml", "width: !!float ''", "cannot be read"),
    "names as keys": (".yaml", "? [1]\n: 2", "cannot be read"),
    "NaN": (*with_value("fx", ".nan"), "rig.fx is nan, a finite number"),
    "NaN in JSON": (*with_value("fx", "NaN", ".json"), "rig.fx is nan, a finite number"),
    "infinity": (*with_value("baseline_m", ".inf"), "rig.baseline_m is inf, a finite number"),
    "infinity by digits": (*with_value("fx", "1e999"), "rig.fx is inf, a finite number"),
    "text": (*with_value("fx", "'500'"), "rig.fx is '500', a number is needed"),
    "bool": (*with_value("width", "true"), "rig.width is True, a number is needed"),
    "bool in JSON": (*with_value("width", "true", ".json"), "rig.width is True, a number is needed"),
    "nothing": (*with_value("fx", "null"), "rig.fx is None, a number is needed"),
    "list as value": (*with_value("fx", "[500]"), r"rig.fx is \[500\], a number is needed"),
    "date": (*with_value("fx", "2001-01-01"), "a number is needed"),
    "half a pixel": (*with_value("width", "64.5"), "whole pixels"),
}


@pytest.mark.parametrize("name", UNUSABLE)
def test_what_is_no_rig_is_one_clear_error(tmp_path, name):
    suffix, text, words = UNUSABLE[name]
    path = tmp_path / f"x{suffix}"
    path.write_text(text)
    start_s = time.monotonic()
    with pytest.raises(RigError, match=rf"rig file .*x\{suffix}: .*({words})") as error:
        read_rig_file(path)
    assert "\n" not in str(error.value) and len(str(error.value)) < 300 + len(str(path))
    assert time.monotonic() - start_s < 30.0, "it must not be read for ever"


def test_binary_is_no_rig(tmp_path):
    (tmp_path / "x.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RigError, match=r"rig file .*x\.yaml: cannot be read .*it is not a text file"):
        read_rig_file(tmp_path / "x.yaml")


def test_a_pipe_and_a_folder_are_no_rig_files(tmp_path):
    os.mkfifo(tmp_path / "x.yaml")
    with pytest.raises(RigError, match=r"x\.yaml: cannot be read .*it is not a file"):
        read_rig_file(tmp_path / "x.yaml")
    with pytest.raises(RigError, match=r"cannot be read \(Is a directory\)"):
        read_rig_file(tmp_path)


@pytest.mark.parametrize("suffix", [".yaml", ".json", ".JSON"])
def test_numbers_with_exponents_are_numbers_in_yaml_as_in_json(tmp_path, suffix):
    path = tmp_path / f"rig{suffix}"
    text = json.dumps(VALUES) if suffix != ".yaml" else yaml.safe_dump(VALUES)
    path.write_text(text.replace("50.0", "5e1").replace("0.15", "1.5E-01"))
    assert read_rig_file(path) == RIG
