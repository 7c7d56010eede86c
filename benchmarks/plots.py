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

"""The pictures of the tables, as PNG."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .frames import Array

PANEL_INCHES = (4.0, 3.4)

DPI = 75
LEGEND_COLUMNS = {1: 2, 3: 3}  # by panels: what fits below them

mpl.rcParams["font.size"] = 9


def save_limit_plot(
    folder: Path, curves: dict[str, list[tuple[float, Array, Array]]], units: Sequence[str]
) -> None:
    """Draw RMS error over noise, one curve a stage, with the bound below them."""
    figure, panels = _panels(units)
    for index, (stage, points) in enumerate(curves.items()):
        noise, errors = _series(points)
        # What a user gets lies on the last stage: drawn so that both are seen.
        style = {"color": f"C{index}", "linestyle": ":" if stage == "final" else "-"}
        for panel, error in zip(panels, errors.T, strict=True):
            panel.loglog(noise, error, marker="o", markersize=3, label=stage, **style)
    bounds = next(iter(curves.values()), [])
    if bounds:
        noise, bound = [point[0] * 100 for point in bounds], np.array([point[2] for point in bounds])
        for panel, values in zip(panels, bound.T, strict=True):
            panel.loglog(noise, values, "k--", label="Cramér-Rao bound")
    _save(figure, panels, folder / "limit.png")


def save_peer_plot(folder: Path, curves: dict[str, list[tuple[float, Array]]], units: Sequence[str]) -> None:
    """Draw RMS error over noise, one curve a method."""
    figure, panels = _panels(units)
    for index, (method, points) in enumerate(curves.items()):
        noise, errors = _series(points)
        for panel, error in zip(panels, errors.T, strict=True):
            if np.isfinite(error).any():
                panel.semilogy(noise, error, color=f"C{index}", marker="o", markersize=3, label=method)
    _save(figure, panels, folder / "peers.png")


def save_size_plot(folder: Path, pixels: Sequence[float], times_ms: Mapping[str, Sequence[float]]) -> None:
    """Draw time over image size, one curve a part."""
    figure, panels = _panels(["ms"])
    for name, times in times_ms.items():
        panels[0].loglog(np.array(pixels) / 1e6, times, marker="o", markersize=3, label=name)
    panels[0].set_xlabel("megapixels of one image")
    panels[0].set_xticks(np.array(pixels) / 1e6, [f"{size / 1e6:.1f}" for size in pixels])
    panels[0].minorticks_off()
    _save(figure, panels, folder / "sizes.png")


def save_search_plot(folder: Path, curves: dict[str, tuple[Array, Array]]) -> None:
    """Draw the share of runs that have reached the optimum over time, one curve an optimiser."""
    figure, panels = _panels(["share of runs at the optimum"])
    for name, (time_ms, share) in curves.items():
        panels[0].step(time_ms, share, where="post", label=name)
    panels[0].set(xscale="log", xlabel="time [ms]", ylim=(-0.02, 1.02))
    _save(figure, panels, folder / "search.png")


def _series(points: Sequence[tuple[Any, ...]]) -> tuple[list[float], Array]:
    """Return noise [%] and errors (n, 3) of one curve."""
    return [point[0] * 100 for point in points], np.array([point[1] for point in points])


def _panels(labels: Sequence[str]) -> tuple[Figure, list[Axes]]:
    width, height = PANEL_INCHES
    figure, panels = plt.subplots(
        1, len(labels), figsize=(width * len(labels), height), squeeze=False, layout="constrained"
    )
    for panel, label in zip(panels[0], labels, strict=True):
        panel.set(xlabel="noise [% of full scale]", ylabel=label)
        panel.grid(visible=True, which="both", linewidth=0.3)
    return figure, list(panels[0])


def _save(figure: Figure, panels: Sequence[Axes], path: Path) -> None:
    labelled = {
        label: line
        for panel in panels
        for line, label in zip(*panel.get_legend_handles_labels(), strict=True)
    }
    figure.legend(
        labelled.values(),
        labelled,
        loc="outside lower center",
        ncols=LEGEND_COLUMNS[len(panels)],
        fontsize=7,
        frameon=False,
    )
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=DPI, metadata={"Software": None})
    plt.close(figure)
