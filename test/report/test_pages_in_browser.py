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

"""Report, index and history in a browser, as wide as a screen and as a phone: nothing is cut off or tiny."""

import html
import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stereo_selfcal import Extrinsics
from stereo_selfcal.fleet.history import DriveResult, Known, history_of
from stereo_selfcal.fleet.history_page import history_page
from stereo_selfcal.fleet.index import index_page
from stereo_selfcal.fleet.outcome import BagOutcome, Status
from stereo_selfcal.offline import BagSource, calibrate_recording
from stereo_selfcal.report.page import render_report

ROOT = Path(__file__).resolve().parents[2]
BROWSER = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chromium-browser")
WIDTHS_PX = (1280, 390)
LEAST_LETTERS_PX, LEAST_CHART_LETTERS_PX = 11.0, 12.0

pytestmark = pytest.mark.skipif(BROWSER is None, reason="needs chromium or google-chrome")

# Runs beside a page in a frame: what sticks out of it, the smallest letters, and texts of charts that touch.
MEASURE = """
const page = document.querySelector("iframe").contentDocument, width = page.documentElement.clientWidth;
const found = {width, out: [], letters: 99, chart: 99, touching: []};
page.querySelectorAll("body *").forEach(each => {
  const box = each.getBoundingClientRect();
  if (!box.width || ["SCRIPT", "STYLE"].includes(each.tagName)) return;
  const name = each.tagName + " " + each.textContent.slice(0, 30), chart = each.closest("svg");
  if (box.right > width + 1 || box.left < -1) found.out.push(name);
  const inline = getComputedStyle(each).display === "inline";
  if (!chart && !inline && each.scrollWidth > each.clientWidth + 1) found.out.push("inside " + name);
  if (![...each.childNodes].some(node => node.nodeType === 3 && node.textContent.trim())) return;
  const size = parseFloat(getComputedStyle(each).fontSize);
  if (!chart) { found.letters = Math.min(found.letters, size); return; }
  const around = chart.getBoundingClientRect();
  found.chart = Math.min(found.chart, size * around.width / chart.viewBox.baseVal.width);
  if (box.left < around.left - 1 || box.right > around.right + 1) found.out.push("text " + name);
  if (box.top < around.top - 1 || box.bottom > around.bottom + 1) found.out.push("text " + name);
});
page.querySelectorAll("svg").forEach(chart => {
  const texts = [...chart.querySelectorAll("text")], boxes = texts.map(text => text.getBoundingClientRect());
  boxes.forEach((a, i) => boxes.slice(i + 1).forEach((b, j) => {
    const across = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const down = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top), other = texts[i + 1 + j];
    if (across > 1 && down > 4) found.touching.push(texts[i].textContent + "/" + other.textContent);
  }));
});
const told = document.createElement("pre");
told.id = "found";
told.textContent = JSON.stringify(found);
document.body.replaceChildren(told);
"""


def measured(page, width_px, folder):
    """Return what the browser says of a page in a frame of some width."""
    frame = f'<iframe style="border:0" width="{width_px}" height="900" srcdoc="{html.escape(page)}">'
    file = folder / "frame.html"
    script = f"<script>addEventListener('load', () => {{ {MEASURE} }});</script>"
    file.write_text(f"<!DOCTYPE html><meta charset=utf-8><body>{frame}</iframe>{script}", encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder / 'profile'}"]
    command = [BROWSER, *options, "--window-size=1400,1000", "--dump-dom", file.as_uri()]
    said = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    return json.loads(html.unescape(said.partition('<pre id="found">')[2].partition("</pre>")[0]))


def report():
    with BagSource([ROOT / "bags" / "noisy_10"]) as source:
        return render_report(source, calibrate_recording(source))


def index():
    """Return the page of a fleet with long names and long sentences."""
    name = f"/data/{'a_drive_through_the_city/' * 4}{'x' * 60}.mcap"
    said = f"calibrated; {'not checked against the texture; ' * 8}"
    good = BagOutcome(
        name, Status.CALIBRATED, message=said, frames=12345,
        accepted=12000, confirmed=11000, moves=2, extrinsics=Extrinsics(1.6335, -0.0127, -0.0053),
        std=Extrinsics(0.0092, 0.0028, 0.005), with_reservations=True, yaw_rad=-0.006, yaw_std_rad=0.0024,
        alignment="calibrate_again", alignment_pitch_rad=-1e-3, alignment_pitch_std_rad=5e-5,
        uncertainty=f"71 % {'motion of the car ' * 6}", progress="after 1 frame 9.1 mm, 0.21, 0.29 deg",
        report="reports/a.html",
    )  # fmt: skip
    refused = BagOutcome("b", Status.REFUSED, reason="lines_not_matched", frames=3)
    return index_page([good, refused, replace(good, bag="c", with_reservations=False)], "made by us")


def history():
    rng = np.random.default_rng(1)
    names = ("height_m", "pitch_rad", "roll_rad", "yaw_rad", "alignment_pitch_rad", "alignment_yaw_rad")
    drives = [
        DriveResult(
            f"/data/{'a_drive_through_the_city/' * 3}{index}.mcap", 1.7e9 + 1e5 * index,
            {name: Known(rng.normal(0.0, 0.003) + 0.05 * (index > 20), 0.003) for name in names},
        )
        for index in range(30)
    ]  # fmt: skip
    return history_page(history_of(drives), ["one is left out"], "made by us")


@pytest.mark.parametrize("make", [report, index, history])
def test_a_page_fits_a_screen_and_a_phone(make, tmp_path):
    page = make()
    for width_px in WIDTHS_PX:
        found = measured(page, width_px, tmp_path)
        assert found["width"] == pytest.approx(width_px, abs=20)  # a scroll bar may be beside it
        assert found["out"] == []
        assert found["touching"] == []
        assert LEAST_LETTERS_PX <= found["letters"] < 99
        assert found["chart"] >= LEAST_CHART_LETTERS_PX


def test_the_browser_tells_what_sticks_out_and_what_is_tiny(tmp_path):
    page = (
        index()
        .replace("overflow-wrap: anywhere", "white-space: nowrap")
        .replace("font-size: .9rem", "font-size: 9px")
    )
    found = measured(page, 390, tmp_path)
    assert found["out"]
    assert found["letters"] == 9.0
