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

"""The output that README.md and docs/ show is what the commands print today.

Words and layout are compared exactly. With the versions that requirements/base.txt pins, a number may differ
by one in its last digit, or by a hundred thousandth: the same input and seed give the same bytes on one
machine, but processors add in another order. With other versions of NumPy and OpenCV (a vehicle's), a noisy
frame may raise another doubt, and with it another standard deviation: there only the words are compared.
``python -m benchmarks.outputs`` puts the output of today into the pages.
"""

import math
import re

import pytest

from benchmarks import outputs

BLOCKS = list(outputs.blocks())


def test_numbers_may_differ_in_their_last_digit_only():
    found = outputs.NUMBER.findall("640 x 480 px, -1.080 and 1e-05, f516 v1.2.3")
    assert found == ["640", "480", "-1.080", "1e-05"]
    assert math.isclose(outputs.last_digit("-1.080"), 1e-3)
    assert math.isclose(outputs.last_digit("2.50e-07"), 1e-9)
    assert not outputs.differences("roll -1.080", "roll -1.081", exact=True)
    assert outputs.differences("roll -1.080", "roll -1.082", exact=True) == [("-1.080", "-1.082")]
    assert not outputs.differences("roll -1.080", "roll -1.100", exact=False)
    assert outputs.words_of("std 1.4 mm, 2 of  2") == outputs.words_of("std 4.0 mm, 2 of 2")
    assert outputs.words_of("std 1.4 mm, 2 of 2") != outputs.words_of("std 1.4 m, 2 of 2")


def parameter(block: outputs.Block):
    """Return a block as a parameter of a test: the demo needs ROS 2."""
    marks = [pytest.mark.ros] if " demo" in block.command else []
    return pytest.param(block, marks=marks, id=f"{block.page.name}: {block.command}")


def test_pages_show_output_of_each_kind():
    commands = " ".join(block.command for block in BLOCKS)
    assert all(f"stereo_selfcal {name}" in commands for name in ("demo", "replay", "limits"))
    for page in outputs.pages():
        text = page.read_text(encoding="utf-8")
        assert text.count("<!-- output") == len(outputs.MARKED.findall(text)), page.name


# On a machine with much else to do, the recording of the demo begins anew before the node has answered.
BEGUN_ANEW = re.compile(
    r"; \d+ left and \d+ right images came twice \(one stamp and the same bytes\): each counts once"
)


# Which of its frames a live node has seen when the call ends differs by one or two, as does what is told of
# single frames.
OF_FRAMES = re.compile(r"(?:; [^;]*\(\d+ of \d+ frames\))+")


def comparable(text):
    """Return what can be compared: which cause has most of a variance depends on the versions."""
    lines = OF_FRAMES.sub("", BEGUN_ANEW.sub("", text)).splitlines()
    return "\n".join(
        line for line in lines if outputs.pinned() or not line.lstrip().startswith("its variance")
    )


def test_a_recording_that_began_anew_changes_nothing_of_what_is_compared():
    told = "; 3 left and 2 right images came twice (one stamp and the same bytes): each counts once"
    assert comparable(f"reached{told}; saved") == "reached; saved"
    of_frames = (
        "; from the road surface, confirmed by one line only (8 of 29 frames); not refined (4 of 29 frames)"
    )
    assert comparable(f"travel{of_frames}; reached") == "travel; reached"


@pytest.mark.slow
@pytest.mark.parametrize("block", [parameter(block) for block in BLOCKS])
def test_output_is_what_the_command_prints(block: outputs.Block):
    shown, printed = comparable(block.text), comparable(outputs.run(block.command))
    assert outputs.words_of(printed) == outputs.words_of(shown)
    if not block.one_run and outputs.pinned():
        assert not outputs.differences(shown, printed, exact=True)
