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

"""The docs say what is so: their commands run, their links lead somewhere, their figures can be made anew."""

import os
import re
import runpy
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest
import yaml
from commands_not_run import why_not_run

from stereo_selfcal.__main__ import COMMANDS

ROOT = Path(__file__).resolve().parent.parent
PAGES = [*sorted((ROOT / "docs").glob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
HOOKS = runpy.run_path(str(ROOT / "docs" / "site_hooks.py"))

FENCE = re.compile(r"^```([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
# Run here, and named after what runs them; what needs a vehicle or takes minutes is compared by its names.
RUN, NAMES = "test", "ros"
RECIPE = "recipe"  # what test_extending.py follows
RUNNERS = {"bash": ["bash", "-e"], "python": [sys.executable]}
TRANSCRIPT = re.compile(r"^\$ (.+)$", re.MULTILINE)
NEEDS_ROS = ("node", "demo")
PROGRAMS = (
    "ros2 ",
    "make ",
    "python -m ",
    "rosdep ",
    "colcon ",
    "pip ",
    "sudo ",
    "source ",
    "stereo_selfcal ",
)
# Commands in the midst of a sentence.
IN_WORDS = re.compile(r"`((?:make|python3? -m|ros2|colcon|pip|git|\.ci/run)(?: [^`]+)?)`")


@dataclass(frozen=True)
class Block:
    page: Path
    info: str
    text: str

    @property
    def words(self) -> list[str]:
        return self.info.split()


def blocks(page: Path) -> Iterator[Block]:
    for match in FENCE.finditer(page.read_text(encoding="utf-8")):
        yield Block(page, match[1].strip(), match[2])


ALL = [block for page in PAGES for block in blocks(page)]


def runnable(page: Path) -> list[Block]:
    return [block for block in blocks(page) if block.words[1:] == [RUN]]


def commands() -> Iterator[str]:
    """Yield every command line that is not run: of marked blocks, of transcripts, of the README's blocks."""
    for block in ALL:
        if block.words[1:] == [NAMES]:
            yield from joined(block.text)
        elif not block.info:
            yield from (match.rstrip() for match in TRANSCRIPT.findall(block.text))
            yield from (line for line in joined(block.text) if line.startswith(PROGRAMS))


def joined(text: str) -> list[str]:
    lines = text.replace("\\\n", " ").splitlines()
    return [line for line in (re.sub(r"\s+# .*", "", each).strip() for each in lines) if line]


@pytest.mark.slow
@pytest.mark.parametrize("page", [p for p in PAGES if runnable(p)], ids=lambda page: page.name)
def test_commands_of_a_page_run(page: Path, tmp_path: Path):
    """One after the other, in one folder, as somebody who follows the page does."""
    (tmp_path / "bags").symlink_to(ROOT / "bags")
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "python").symlink_to(sys.executable)
    python_path = os.pathsep.join(dict.fromkeys([str(ROOT), *filter(None, sys.path)]))
    path = os.pathsep.join([str(tmp_path / "bin"), os.environ["PATH"]])
    environment = os.environ | {"PATH": path, "PYTHONPATH": python_path}
    for block in runnable(page):
        command = [*RUNNERS[block.words[0]], "/dev/stdin"]
        run = subprocess.run(
            command,
            cwd=tmp_path,
            env=environment,
            input=block.text,
            capture_output=True,
            text=True,
            check=False,
        )
        assert run.returncode == 0, f"{block.text}\n{run.stdout}\n{run.stderr}"


def test_every_block_of_code_in_docs_is_run_or_compared():
    loose = [
        (block.page.name, block.text)
        for block in ALL
        if block.page.parent == ROOT / "docs"
        and block.words[:1] in (["bash"], ["sh"], ["console"], ["python"])
        and block.words[1:] not in ([RUN], [NAMES], [RECIPE])
    ]
    assert not loose


@cache
def help_of(command: str) -> str:
    run = subprocess.run(
        [sys.executable, "-m", "stereo_selfcal", command, "--help"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return run.stdout


def check_program(name: str, rest: str) -> None:
    assert name in COMMANDS
    if name not in NEEDS_ROS:
        assert set(OPTION.findall(rest)) <= set(OPTION.findall(help_of(name))) | {"--ros-args"}


def test_every_command_is_run_or_listed_with_why_it_is_not():
    quoted = set(commands())
    for page in PAGES:
        quoted |= set(IN_WORDS.findall(FENCE.sub("", page.read_text(encoding="utf-8"))))
    assert quoted and not sorted(command for command in quoted if not why_not_run(command))


def test_commands_that_are_not_run_name_what_exists():
    targets = set(
        re.findall(r"^([a-z.][a-z-]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    )
    parameters = re.findall(
        r"[a-z_]+(?=:)", (ROOT / "config/stereo_selfcal.yaml").read_text(encoding="utf-8")
    )
    seen = 0
    for line in commands():
        seen += 1
        words = line.split()
        if words[0] == "make":
            assert words[1] in targets, line
        elif words[:3] == ["ros2", "run", "stereo_selfcal"] or words[:3] == [
            "python",
            "-m",
            "stereo_selfcal",
        ]:
            check_program(words[3], " ".join(words[4:]))
        elif words[:3] == ["ros2", "launch", "stereo_selfcal"]:
            assert (ROOT / "launch" / words[3]).is_file(), line
            names = {word.partition(":=")[0].split(".")[-1] for word in words[4:] if ":=" in word}
            assert names <= {*parameters, "camera"}, line
        elif words[:2] == ["ros2", "param"]:
            assert words[3] == "/stereo_selfcal", line
            for word in words[4:5]:  # `list` and `dump` name none
                name = word.removeprefix("extrinsics.")
                assert name in {*parameters, "height_m", "pitch_rad", "roll_rad"}, line
        elif words[:3] == ["ros2", "service", "call"]:
            assert words[3].startswith("/stereo_selfcal/"), line
    assert seen


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files_and_headings(page: Path):
    for link in HOOKS["links_of"](page.read_text(encoding="utf-8")):
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.is_file(), f"{page.name}: {link}"
        if anchor and target.suffix == ".md":
            text = HOOKS["CODE"].sub("", target.read_text(encoding="utf-8"))
            assert anchor in {HOOKS["slug"](heading) for _, heading in HOOKS["HEADING"].findall(text)}, link


def test_what_is_included_is_there():
    included = 0
    for page in HOOKS["pages"]():
        for match in HOOKS["INCLUDE"].finditer(page.read_text(encoding="utf-8")):
            assert HOOKS["section"](match[1], match[2]).strip(), match[0]
            included += 1
    assert included


def test_included_links_lead_on_from_the_page_they_are_shown_on():
    text = "[node](docs/node.md#pictures) [table](benchmarks/results/limit.md) [code](#how-it-works) `[a](b)`"
    shown = HOOKS["relinked"](text, "README.md", "docs/accuracy.md")
    targets = ("node.md#pictures", "benchmarks/results/limit.md", "index.md#how-it-works")
    assert re.findall(r"\]\(([^)]+)\)", shown) == [*targets, "b"]


def test_cells_of_a_table_name_their_columns():
    table = (
        '<table>\n<thead>\n<tr>\n<th>a <em>b</em></th>\n<th style="text-align: right">"c"</th>\n</tr>\n'
        '</thead>\n<tbody>\n<tr>\n<td>1</td>\n<td style="text-align: right">2</td>\n</tr>\n</tbody>\n</table>'
    )
    shown = HOOKS["on_page_content"](f"<p>x</p>{table}<p>y</p>")
    assert '<td data-label="a b">1</td>' in shown
    assert '<td data-label="&quot;c&quot;" style="text-align: right">2</td>' in shown
    assert re.sub(r' data-label="[^"]*"', "", shown) == f"<p>x</p>{table}<p>y</p>"


def test_every_page_is_on_the_site():
    nav = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]
    without = [entry for entry in nav if "Extending" not in entry]
    whole = HOOKS["with_all_pages"](without)
    assert "extending.md" in next(
        part for entry in whole for title, part in entry.items() if title == "Reference"
    )
    for page in HOOKS["pages"]():
        assert repr(whole).count(f"'{page.name}'") == 1


def test_drawings_are_those_of_the_code():
    figures = pytest.importorskip("benchmarks.figures")
    for name in ("alignment.svg", "frames.svg", "data_flow.svg"):
        assert (ROOT / "docs" / "figures" / name).read_bytes() == figures.FIGURES[name]()
    made = {path.name for path in (ROOT / "docs" / "figures").iterdir()}
    assert made == set(figures.FIGURES)


# Another processor may round the last digits of a few readings otherwise, of 15 to 30 pixels each. A word
# that has changed in all of them, or a line that has moved, is a thousand pixels.
OTHER_GREY, FEW_PIXELS = 60, 200


@pytest.mark.slow
def test_pictures_are_those_of_today():
    """Made with other versions of OpenCV, letters look otherwise: then only their sizes are compared."""
    figures, outputs = pytest.importorskip("benchmarks.figures"), pytest.importorskip("benchmarks.outputs")
    cv2, np = pytest.importorskip("cv2"), pytest.importorskip("numpy")
    for name, make in figures.FIGURES.items():
        if name.endswith(".svg"):
            continue
        made = cv2.imdecode(np.frombuffer(make(), np.uint8), cv2.IMREAD_COLOR)
        kept = cv2.imread(str(ROOT / "docs" / "figures" / name), cv2.IMREAD_COLOR)
        if outputs.pinned():
            assert made.shape == kept.shape, f"{name}: make figures"
            differs = np.abs(made.astype(int) - kept).max(axis=2) > OTHER_GREY
            assert np.count_nonzero(differs) <= FEW_PIXELS, f"{name}: make figures"
        else:
            assert made.shape[1] == kept.shape[1], name
