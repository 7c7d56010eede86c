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

"""docs/method.md is about this code: its figure, its tables, its names; and its sentences are short."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from benchmarks.data_flow import NOT_ON_THE_WAY, ROWS, modules_beside, modules_in_figure
from stereo_selfcal.core.evidence.frame_evidence import FoundBy
from stereo_selfcal.core.evidence.gates import GATES
from stereo_selfcal.core.geometry.uncertainty import TERMS
from stereo_selfcal.core.rejection import RejectReason

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "stereo_selfcal"
DOCS = ROOT / "docs"
METHOD = (DOCS / "method.md").read_text(encoding="utf-8")
PAGES = [*sorted(DOCS.glob("*.md")), ROOT / "README.md"]

MEDIAN_WORDS, P90_WORDS = 18, 35

# A full stop after these ends no sentence, and neither does one after an initial.
ABBREVIATIONS = ("pp", "vol", "al", "Phys", "Rev", "Proc", "Syst", "e.g", "i.e", "vs")


def sentences_of(markdown: str) -> list[str]:
    """Return the sentences of a page, without code, tables, headings, pictures and comments.

    A sentence ends at a full stop, an exclamation mark, a question mark or a semicolon before a space, at the
    end of a paragraph, and at the end of an item of a list. A colon does not end one. Of a link, its text
    counts.
    """
    text = re.sub(r"^```.*?^```$", "\n", markdown, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"<!--.*?-->", "\n", text, flags=re.DOTALL)
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)", "\n\n", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    lines = ["" if re.match(r"\s*(\||#+ )", line) else line for line in text.splitlines()]
    lines = [re.sub(r"^\s*([*-]|\d+\.) ", "\n", line) for line in lines]
    found = []
    for paragraph in re.split(r"\n\s*\n", "\n".join(lines)):
        held = ""
        for part in re.split(r"(?<=[.!?;])\s+", " ".join(paragraph.split())):
            held = f"{held} {part}".strip()
            last = held.rstrip(".").rsplit(maxsplit=1)[-1].lstrip("(") if held.rstrip(".") else ""
            initial = held.endswith(".") and (last in ABBREVIATIONS or re.fullmatch(r"[A-Z]", last))
            if held and not initial:
                found.append(held)
                held = ""
        if held:
            found.append(held)
    return found


def words_of(sentence: str) -> list[str]:
    """Return the words of a sentence: whatever stands between spaces and has a letter or a digit."""
    return [word for word in sentence.split() if re.search(r"\w", word)]


def lengths_of(markdown: str) -> tuple[float, float]:
    """Return the median and the 90th percentile of the words in a sentence."""
    counts = [len(words_of(sentence)) for sentence in sentences_of(markdown)]
    return (float(np.median(counts)), float(np.percentile(counts, 90))) if counts else (0.0, 0.0)


def test_sentences_are_found():
    text = """# A heading. Not one

The first is here; the second (R. T. Birge, Phys. Rev. 40, 1932) has 1.5 px. The [third](a.md "b") asks: why?

* An item
* Another. With two

| a table. | is none |

```python
nor = "is. code"
```
![nor. a picture](a.png)
"""
    assert sentences_of(text) == [
        "The first is here;",
        "the second (R. T. Birge, Phys. Rev. 40, 1932) has 1.5 px.",
        "The third asks: why?",
        "An item",
        "Another.",
        "With two",
    ]
    assert len(words_of("the second - has 1.5 px (about)")) == 6


def test_sentences_of_the_method_are_short():
    median, p90 = lengths_of(METHOD)
    assert median <= MEDIAN_WORDS, f"median of {median:g} words a sentence"
    assert p90 <= P90_WORDS, f"90th percentile of {p90:g} words a sentence"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_long_sentences_of_the_other_pages_are_reported(page: Path):
    """They do not fail: `pytest -W default` shows what is left to do."""
    median, p90 = lengths_of(page.read_text(encoding="utf-8"))
    if median > MEDIAN_WORDS or p90 > P90_WORDS:
        warnings.warn(
            f"{page.name}: median {median:g}, 90th percentile {p90:g} words a sentence", stacklevel=1
        )


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pages_use_the_terms_of_the_field(page: Path):
    """Words that this project had made up: the glossary has those that took their place."""
    text = page.read_text(encoding="utf-8").replace("asphalt or concrete", "")  # what a road surface is
    assert not re.findall(r"\b(?:witness\w*|buried|rims?|in force|further lines?|asphalts?)\b", text)


def test_modules_of_the_figure_exist():
    named = [*modules_in_figure(), *modules_beside()]
    missing = [name for name in named if not (PACKAGE / f"{name}.py").is_file()]
    assert not missing
    assert len(set(named)) == len(named)  # none twice: each is passed once


def test_every_module_of_core_is_in_the_figure_or_beside_it():
    core = PACKAGE / "core"
    modules = {path.relative_to(PACKAGE).with_suffix("").as_posix() for path in core.rglob("*.py")}
    modules = {name for name in modules if not name.endswith("__init__")}
    assert modules == {name for name in (*modules_in_figure(), *modules_beside()) if name.startswith("core/")}


def test_stages_of_the_figure_are_sections_of_the_page():
    headings = re.findall(r"^## (\d+ .+)$", METHOD, re.MULTILINE)
    assert headings == [" ".join(row.title) for row in ROWS]


def test_modules_beside_the_way_are_those_of_the_page():
    start = METHOD.index("| modules of core |")
    rows = METHOD[start : METHOD.index("\n\n", start)].splitlines()[2:]
    listed = [re.findall(r"`([^`]+)`", row.split("|")[1]) for row in rows]
    assert listed == [names.split(", ") for names in NOT_ON_THE_WAY]


def rows_of_table(heading: str) -> list[list[str]]:
    start = METHOD.index(heading)
    lines = METHOD[start : METHOD.find("\n\n", start)].splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]


def test_table_of_the_gates_is_that_of_the_code():
    rows = rows_of_table("| key | label | reason | measured |")
    assert all(len(row) == 6 for row in rows)
    listed = [(key.strip("`"), label, reason.strip("`")) for key, label, reason, *_ in rows if key]
    assert listed == [(gate.key, gate.label, str(gate.reason)) for gate in GATES]
    assert all(row[3] and row[4] and row[5] for row in rows)
    assert all(re.match(r"at (most|least) ", row[4]) for row in rows)


def test_conditions_before_an_estimate_have_reasons_that_exist():
    rows = rows_of_table("| reason | measured | limit |")
    assert {row[0].strip("`") for row in rows} <= {str(reason) for reason in RejectReason}


def test_table_of_the_terms_is_that_of_the_code():
    rows = rows_of_table("| term | what is unknown |")
    assert [row[0].strip("`") for row in rows] == list(TERMS)
    assert all(len(row) == 3 and all(row) for row in rows)


def test_ways_to_find_lines_are_those_of_the_code():
    rows = rows_of_table("| step | found by |")
    assert {name for row in rows for name in re.findall(r"`(\w+)`", row[1])} == {str(way) for way in FoundBy}


def test_modules_named_in_the_text_exist():
    """Names like `evidence/profile`, with or without a name defined in it behind."""
    rooms = {path.name for path in (PACKAGE / "core").iterdir() if path.is_dir()}
    named = {name for name in re.findall(r"`(\w+/\w+)`", METHOD) if name.split("/")[0] in rooms}
    assert len(named) > 10
    assert not [name for name in named if not (PACKAGE / "core" / f"{name}.py").is_file()]
