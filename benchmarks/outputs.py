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

"""The real output that README.md and docs/ show: ``python -m benchmarks.outputs`` makes it anew.

A block of output stands below a comment with the command that made it::

    <!-- output: python -m stereo_selfcal replay bags/noisy_10 -->

``test/test_readme_output.py`` runs the commands and compares. Where the comment says ``output, one run``, the
numbers depend on which frame came first; then only the words are compared.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

MARKED = re.compile(
    r"^<!-- output(?P<one_run>, one run)?: (?P<command>.+?) -->\n(?P<fence>```\w*)\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
NUMBER = re.compile(r"(?<![\w.])[+-]?\d+(?:\.\d+)?(?:e[+-]\d+)?(?![\w.]*\w)")
# By how much a number may differ, of itself.
OF_ANOTHER_PROCESSOR, OF_ANOTHER_VERSION = 1e-5, 0.05
# What is of the machine and not of the package, as it is shown.
_FOLDER, _PROCESS = "/home/you/stereo_selfcal", "process 32403"


@dataclass(frozen=True)
class Block:
    """Output that a page shows.

    Attributes:
        page: The page.
        command: What made it, for a shell in a checkout.
        text: The output.
        one_run: Whether its numbers differ from run to run.
    """

    page: Path
    command: str
    text: str
    one_run: bool


def pinned() -> bool:
    """Return whether NumPy and OpenCV are those that output and pictures were made with."""
    text = (ROOT / "requirements" / "base.txt").read_text(encoding="utf-8")
    return all(
        version(name) in re.findall(rf"^{name}==([\d.]+)", text, re.MULTILINE)
        for name in ("numpy", "opencv-python-headless")
    )


def pages() -> list[Path]:
    """Return the pages that may show output."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks() -> Iterator[Block]:
    """Yield all marked blocks."""
    for page in pages():
        for match in MARKED.finditer(page.read_text(encoding="utf-8")):
            yield Block(page, match["command"], match["text"], match["one_run"] is not None)


def run(command: str) -> str:
    """Run a command in an empty folder that has the bags of the checkout, and return what it prints.

    Raises:
        subprocess.CalledProcessError: It failed.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        (folder / "bags").symlink_to(ROOT / "bags")
        (folder / "bin").mkdir()
        (folder / "bin" / "python").symlink_to(sys.executable)
        path = os.pathsep.join([str(folder / "bin"), os.environ["PATH"]])
        python_path = os.pathsep.join(dict.fromkeys([str(ROOT), *filter(None, sys.path)]))
        done = subprocess.run(
            ["/bin/bash", "-e", "-c", command],
            cwd=folder,
            env=os.environ | {"PATH": path, "PYTHONPATH": python_path, "PWD": str(folder)},
            capture_output=True,
            text=True,
            check=True,
        )
    shown = done.stdout.replace(str(folder), _FOLDER)
    return re.sub(r"process \d+", _PROCESS, shown)


def words_of(text: str) -> str:
    """Return a text with its numbers, and how they are aligned, left out."""
    return re.sub(r"[ -]+", " ", NUMBER.sub("#", text))


def last_digit(number: str) -> float:
    """Return the place value of the last digit of a number."""
    mantissa, _, exponent = number.partition("e")
    return 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))


def differences(shown: str, printed: str, *, exact: bool) -> list[tuple[str, str]]:
    """Return the pairs of numbers that differ by more than they may."""
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=True)
    return [
        (a, b)
        for a, b in pairs
        if abs(float(a) - float(b))
        > 1.01 * last_digit(a) + (OF_ANOTHER_PROCESSOR if exact else OF_ANOTHER_VERSION) * abs(float(a))
    ]


def main() -> int:
    """Put the output of today into the pages."""
    for page in pages():
        text = page.read_text(encoding="utf-8")

        def renewed(match: re.Match[str]) -> str:
            sys.stdout.write(f"{match['command']}\n")
            printed = run(match["command"])
            same = words_of(printed) == words_of(match["text"])
            if same and (match["one_run"] or not differences(match["text"], printed, exact=True)):
                return match[0]
            return f"{match[0][: match.start('text') - match.start()]}{printed}```"

        changed = MARKED.sub(renewed, text)
        if changed != text:
            page.write_text(changed, encoding="utf-8")
            sys.stdout.write(f"{page} is renewed\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
