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

"""Texts from outside in messages."""

import pytest

from stereo_selfcal.core.errors import ConfigError, one_line, printable


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("/stereo/left/image_rect", "/stereo/left/image_rect"),
        ("Straße 東京", "Straße 東京"),
        ("a\nstereo_selfcal: calibrated", "a\\nstereo_selfcal: calibrated"),
        ("\x1b[2Jgone", "\\x1b[2Jgone"),
        ("\u202egnp.1", "\\u202egnp.1"),
        (b"caf\xe9.png".decode("utf-8", "surrogateescape"), "caf\\udce9.png"),
        ("a\u2028b\x85c\x7f", "a\\u2028b\\x85c\\x7f"),
    ],
)
def test_a_text_from_outside_stays_on_one_line_and_can_be_printed(text: str, shown: str) -> None:
    assert printable(text) == shown
    printable(text).encode("utf-8")


def test_a_line_about_an_error_has_a_limit() -> None:
    assert one_line(ConfigError("two\nlines\x1b")) == "two lines\\x1b"
    assert one_line(KeyError()) == "KeyError"
    line = one_line(ConfigError("topics: " + "a" * 10**7))
    assert len(line) < 5000
    assert line.endswith("... (10000008 letters)")
