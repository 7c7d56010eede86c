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

"""The style of the pages of a fleet: its index, and the history of a camera. One file each, no network."""

from __future__ import annotations

from html import escape

from ..report.charts import PHONE_LETTERS

# Colours of Okabe and Ito, which people with any kind of colour vision tell apart; a word is there as well.
# Narrower than 72rem, a table becomes a card a row, as no phone has room for its columns.
_STYLE = f"""
:root {{ color-scheme: light dark; font: 15px/1.45 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif;
  --soft: #5c5c5c; --rule: #d9d9d9; --blue: #0072b2; --vermilion: #d55e00; --orange: #e69f00; }}
@media (prefers-color-scheme: dark) {{ :root {{ --soft: #a8a8a8; --rule: #3a3d40; --blue: #56b4e9;
  --vermilion: #ff8a3d; --orange: #f0b429; }} }}
* {{ box-sizing: border-box; }}
body {{ margin: 0 auto; max-width: 84rem; padding: 1rem; overflow-wrap: anywhere; }}
h1 {{ font-size: 1.4rem; }} h2 {{ font-size: 1.2rem; margin: 2rem 0 .4rem; }}
h3 {{ font-size: 1rem; margin: 1.2rem 0 .2rem; }} .soft {{ color: var(--soft); }}
table {{ border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }}
th, td {{ padding: .3rem .4rem; text-align: left; vertical-align: top; }}
th {{ vertical-align: bottom; overflow-wrap: normal; border-bottom: 2px solid var(--rule); }}
tbody tr:last-child td {{ border-bottom: 1px solid var(--rule); }}
td.n, th.n {{ text-align: right; }} td.n {{ white-space: nowrap; }}
td.name {{ min-width: 9rem; }} td.verdict {{ min-width: 9rem; }}
.sort th {{ cursor: pointer; }}
th[aria-sort=ascending]::after {{ content: " \\2191"; }}
th[aria-sort=descending]::after {{ content: " \\2193"; }}
td.why {{ font-size: .9rem; padding-bottom: .7rem; }} td.why span {{ display: block; }}
.k {{ font-weight: 600; color: var(--soft); }}
b.status {{ display: inline-block; border-left: .5rem solid var(--c); padding-left: .4rem; }}
.calibrated {{ --c: #009e73; }} .refused {{ --c: #e69f00; }} .damaged {{ --c: #cc79a7; }}
.reserved {{ --c: #f0e442; }} .failed {{ --c: #d55e00; }} .not_done {{ --c: #999; }}
.note {{ border-left: .5rem solid #d55e00; padding: .4rem .8rem; }} .calm {{ border-color: #009e73; }}
.note ul {{ margin: 0; padding-left: 1.2rem; }}
.marked {{ color: var(--vermilion); font-weight: 700; }}
.meter {{ display: block; height: .35rem; min-width: 3rem; border: 1px solid var(--rule); }}
.meter i {{ display: block; height: 100%; background: var(--blue); }}
svg {{ width: 100%; max-width: 62rem; height: auto; display: block; }}
svg text {{ fill: var(--soft); font-size: 14px; }}
svg .end {{ text-anchor: end; }} svg .middle {{ text-anchor: middle; }}
svg .grid {{ stroke: var(--rule); }} svg .axis {{ stroke: var(--soft); }}
svg .band {{ fill: var(--orange); opacity: .35; }} svg .mount {{ stroke: var(--orange); stroke-width: 2.5; }}
svg .frame, svg .changed {{ stroke: var(--blue); stroke-width: 7; stroke-linecap: round; fill: none; }}
svg .changed {{ stroke: var(--vermilion); stroke-width: 13; }}
svg .moved {{ stroke: var(--vermilion); stroke-width: 2.5; stroke-dasharray: 7 4; }}
svg .refused {{ stroke: var(--vermilion); stroke-width: 3; }}
@media (max-width: 72rem) {{
  thead {{ display: none; }} table, tbody, tr, td {{ display: block; }}
  tbody {{ border-bottom: 1px solid var(--rule); padding: .5rem 0; }} tbody tr:last-child td {{ border: 0; }}
  td, td.n {{ padding: .1rem 0; text-align: left; white-space: normal; }}
  td.n {{ display: inline-block; margin-right: 1rem; }} td:empty {{ display: none; }}
  td[data-label]::before {{ content: attr(data-label) " "; color: var(--soft); }}
  .meter {{ display: none; }} }}
@media (max-width: 40rem) {{ body {{ padding: .7rem; }} svg text {{ font-size: {PHONE_LETTERS}px; }}
  svg .frame {{ stroke-width: 11; }} svg .changed {{ stroke-width: 19; }} }}
"""


def page_of(title: str, body: str) -> str:
    """Return a whole page.

    Args:
        title: Its title, as text.
        body: Its content, as HTML.
    """
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(title)}</title>
<style>{_STYLE}</style>
</head>
<body>
{body}
</body>
</html>
"""


def number_cell(label: str, text: str, value: float | None = None, more: str = "") -> str:
    """Return the cell of a number, which is sorted by its value.

    Args:
        label: Its heading, which stands before it on a phone.
        text: The number as people read it, as HTML; "" where there is none.
        value: The number; None where there is none.
        more: What is drawn below it, as HTML.
    """
    if not text:
        return '<td class="n"></td>'
    sorted_by = "" if value is None else f' data-v="{value!r}"'
    return f'<td class="n"{sorted_by} data-label="{escape(label, quote=True)}">{text}{more}</td>'


def breakable(name: str) -> str:
    """Return a name as HTML that breaks after its slashes, where it has to."""
    return escape(name).replace("/", "/<wbr>")
