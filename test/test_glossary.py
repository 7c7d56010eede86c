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

"""docs/glossary.md explains words in the order of the alphabet, and names what is in the code."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
ROWS = [
    tuple(cell.strip() for cell in line.strip("|").split(" | "))
    for line in PAGE.splitlines()
    if line.startswith("| ") and line != "| term | meaning |"
]


def names_in_code() -> set[str]:
    """Return what the package defines: modules, classes, functions, arguments, attributes, constants."""
    names = set()
    for path in (ROOT / "stereo_selfcal").rglob("*.py"):
        names.add(path.stem)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef | ast.FunctionDef):
                names.add(node.name)
            elif isinstance(node, ast.arg):
                names.add(node.arg)
            elif isinstance(node, ast.Name):
                names.add(node.id)
            elif isinstance(node, ast.Attribute):
                names.add(node.attr)
    return names


def test_each_term_has_one_line_in_the_order_of_the_alphabet():
    assert len(ROWS) > 50
    assert all(len(row) == 2 and row[1].endswith(".") for row in ROWS)
    terms = [row[0].lower().replace("é", "e").replace("-", " ") for row in ROWS]
    assert terms == sorted(set(terms))


def test_names_exist_in_the_code():
    known = names_in_code()
    named = {part for row in ROWS for name in re.findall(r"`([^`]+)`", row[1]) for part in name.split(".")}
    assert len(named) > 40
    assert named <= known, named - known
