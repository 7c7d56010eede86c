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

"""Texts of parameters end in answers, logs and files: they are printable and of a bounded length."""

import pytest

from stereo_selfcal.core.errors import ConfigError
from stereo_selfcal.files.node_settings import all_settings
from stereo_selfcal.files.parameter_file import load_frames
from stereo_selfcal.ros.config import SETTINGS, NodeConfig

FORGED = "a\nFORGED\x1b[31m"
TEXTS = [setting.name for setting in all_settings() if isinstance(setting.default, str)]


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.parametrize("text", [FORGED, "x" * 100_000])
def test_node_refuses_texts_that_forge_lines_or_are_endless_in_a_short_printable_sentence(name, text):
    values = {each.name: each.default for each in SETTINGS.values()} | {name: text}
    with pytest.raises(ConfigError, match=f"^{name} is ") as raised:
        NodeConfig.from_values(values)
    assert str(raised.value).isprintable() and len(str(raised.value)) < 300


@pytest.mark.parametrize("text", ["Straße/日本", "x" * 255])
def test_frames_of_any_script_and_of_255_characters_are_taken(text):
    values = {each.name: each.default for each in SETTINGS.values()} | {"camera_frame": text}
    assert NodeConfig.from_values(values).camera_frame == text


def test_frames_of_a_parameter_file_are_checked_as_those_of_the_node(tmp_path):
    path = tmp_path / "params.yaml"
    path.write_text('/**:\n  ros__parameters:\n    camera_frame: "a\\nFORGED\\e[31m"\n', encoding="utf-8")
    with pytest.raises(ConfigError, match=r"camera_frame is .* printable characters") as raised:
        load_frames(path)
    assert str(raised.value).isprintable()
