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

"""The recipe of a gate in docs/extending.md, followed word by word in a copy of the code."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
# The words before a block say where it goes.
STEP = re.compile(
    r"At the end of (?P<part>`GATES` in |the table of gates in )?`(?P<file>[^`]+)`:\n\n"
    r"```\w+ recipe\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
MOST_FILES = 4


def insert(text: str, part: str | None, block: str) -> str:
    """Return a file with a block at the end of the part that the page names."""
    if part is None:
        return f"{text}\n\n{block}" if block.startswith(("#", "def", "@")) else text + block
    start = text.index("GATES: tuple[" if "GATES" in part else "| key | label | reason |")
    end = text.index("\n)\n" if "GATES" in part else "\n\n", start) + 1
    return text[:end] + block + text[end:]


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """Return a copy of what the recipe changes, and of what its tests need."""
    unneeded = shutil.ignore_patterns("__pycache__", "results")
    for folder in ("stereo_selfcal", "benchmarks", "docs", "test"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=unneeded)
    for file in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / file, tmp_path)
    return tmp_path


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join(dict.fromkeys([str(folder), *(p for p in sys.path if p and p != str(ROOT))]))
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )


SCENE = """
import stereo_selfcal
from stereo_selfcal import Calibrator
from stereo_selfcal.synth.scenes import named_scene
scene = named_scene("straight_road")
frame = scene.frame(0)
result = Calibrator(scene.scene.rig).add(frame.left, frame.right)
print(stereo_selfcal.__file__, result.reason, result.message)
"""


@pytest.mark.slow
def test_recipe_of_a_gate_makes_a_gate_that_refuses(copy: Path):
    assert " None " in run(copy, "-c", SCENE).stdout  # accepted without it
    steps = list(STEP.finditer(PAGE))
    assert len(steps) == PAGE.count(" recipe\n") == MOST_FILES
    for step in steps:
        file = copy / step["file"]
        file.write_text(
            insert(file.read_text(encoding="utf-8"), step["part"], step["text"]), encoding="utf-8"
        )
    refused = run(copy, "-c", SCENE)
    assert str(copy) in refused.stdout, refused.stderr  # it is the copy that ran
    words = r" search_space_edge the camera is mounted 1\.(4|39\d*) m over the road, at most 1\.2 m allowed"
    assert re.search(words, refused.stdout)
    tests = ("test/core/evidence/test_gates.py", "test/test_method.py")
    chosen = "test_mounting or test_table_of_the_gates"
    tested = run(copy, "-m", "pytest", "-vv", "-p", "no:cacheprovider", *tests, "-k", chosen)
    assert tested.returncode == 0, tested.stdout + tested.stderr
    assert len(re.findall(r"test_mounting\S+ PASSED|test_table_of_the_gates\S+ PASSED", tested.stdout)) == 3


def test_each_recipe_names_at_most_four_files():
    table = PAGE[PAGE.index("| what is added |") : PAGE.index("## A gate")]
    rows = [line.strip("|").split(" | ") for line in table.splitlines() if line.startswith("| [")]
    assert len(rows) == 4
    for name, files in rows:
        assert len(files.split(", ")) <= MOST_FILES, name
        for file in re.findall(r"`([^`]+\.\w+)`", files):
            assert any((ROOT / start / file).exists() for start in ("", "stereo_selfcal")), file


def test_files_and_names_of_the_page_exist():
    text = re.sub(r"^```.*?^```$", "", PAGE, flags=re.MULTILINE | re.DOTALL)
    files = [name for name in re.findall(r"`([\w./]+\.(?:py|md|yaml))`", text) if "your_" not in name]
    assert len(files) > 15
    assert not [
        name for name in files if not any((ROOT / at / name).exists() for at in ("", "stereo_selfcal"))
    ]
    source = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "stereo_selfcal").rglob("*.py"))
    names = {name for name in re.findall(r"`([A-Z]\w+|_?[a-z]+_\w+)`", text) if name != "replay"}
    assert not [name for name in names if not re.search(rf"\b{name}\b", source)]
