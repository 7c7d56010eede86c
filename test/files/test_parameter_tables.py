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

"""The table of parameters in docs/ and the table the node declares its parameters from are one list."""

import re
from fnmatch import fnmatch
from pathlib import Path

import pytest
import yaml

from stereo_selfcal.files.node_settings import all_settings

PAGE = Path(__file__).resolve().parents[2] / "docs" / "parameters.md"
SETTINGS = {setting.name: setting for setting in all_settings()}
HEADING = "| parameter | default | range | what it does |"


def rows():
    """Return {name or pattern: (default, range)} of the page's table."""
    lines = iter(PAGE.read_text(encoding="utf-8").splitlines())
    assert HEADING in lines, f"docs/parameters.md has no table {HEADING}"
    next(lines)
    found = {}
    for line in lines:
        if not line.startswith("|"):
            break
        names, default, span, _ = (cell.strip() for cell in line.strip("|").split("|"))
        for name in re.findall(r"`([^`]+)`", names):
            assert name not in found, f"{name} is there twice"
            found[name] = default.strip("`"), span
    return found


def test_every_parameter_is_in_one_row_and_every_row_is_a_parameter():
    for name in SETTINGS:
        assert len([pattern for pattern in rows() if fnmatch(name, pattern)]) == 1, name
    for pattern in rows():
        assert any(fnmatch(name, pattern) for name in SETTINGS), pattern


@pytest.mark.parametrize("name", [name for name in rows() if "*" not in name])
def test_row_has_the_default_and_the_range(name):
    setting, (default, span) = SETTINGS[name], rows()[name]
    assert yaml.safe_load(default) == setting.default
    assert ("only at the start" in span) == setting.fixed
    assert all(f"`{choice}`" in span for choice in setting.choices)
    if setting.low is not None:
        low, _, high, *unit = span.split()
        assert (float(low), float(high), " ".join(unit)) == (setting.low, setting.high, setting.unit)
