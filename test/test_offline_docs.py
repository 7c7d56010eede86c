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

"""docs/offline.md names every option of replay, every column of its table, and has a program that runs."""

import re
from pathlib import Path

from stereo_selfcal.cli.replay_options import replay_parser
from stereo_selfcal.offline.csv_table import COLUMNS

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "offline.md").read_text(encoding="utf-8")


def test_options():
    known = {option for action in replay_parser()._actions for option in action.option_strings} - {
        "-h",
        "--help",
    }
    table = PAGE[PAGE.index("| option | does |") : PAGE.index("Seconds count from")]
    assert set(re.findall(r"`(--[a-z-]+)", table)) == known


def test_columns():
    text = PAGE[PAGE.index("The columns of `--csv`") : PAGE.index("### Damaged recordings")]
    for name in COLUMNS:
        if not name.endswith(("_std_m", "_std_rad")) and not name.startswith("gate_"):
            assert name in text


def test_the_program_runs(capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    program = re.search(r"```python[^\n]*\n(.*?)```", PAGE, re.DOTALL).group(1)
    exec(compile(program, "docs/offline.md", "exec"), {"__name__": "__main__"})
    lines = capsys.readouterr().out.splitlines()
    assert re.match(r"calibrated from 5 frames in 0.4 s: height (1\.40|1\.39[89])", lines[0])
    assert len(lines) == 6
