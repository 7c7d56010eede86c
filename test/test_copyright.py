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

"""Every source file begins with the licence, as ament_copyright asks of packages of ROS."""

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
HEADER = Path(__file__).read_text(encoding="utf-8").partition("\n\n")[0] + "\n"
FOLDERS = ("stereo_selfcal", "launch", "test", "benchmarks", "examples", "docs")


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_source_file_begins_with_the_licence(folder):
    assert "Apache License, Version 2.0" in HEADER and HEADER.count("\n") == 13
    without = [
        str(path.relative_to(ROOT))
        for path in sorted((ROOT / folder).rglob("*.py"))
        if not path.read_text(encoding="utf-8").removeprefix("#!/usr/bin/env python3\n\n").startswith(HEADER)
    ]
    assert not without, "begin them with the first lines of any other file"
