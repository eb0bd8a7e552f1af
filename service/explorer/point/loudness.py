"""Show how hard the motions of a point rattle: a table of intensities, the order spectrum of one motion, its sound."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource

import rattle
from gear_rattle.service.explorer.common.figures import line_colour, themed_figure
from gear_rattle.service.explorer.common.glyphs import remove_rows
from gear_rattle.service.explorer.design.rattling import HIGHEST_SPECTRUM_ORDER
from gear_rattle.service.explorer.point.words import folded_html_table, number_text, swatch_html
from rattle import Machine, SpectralDensity, SpectralLines
from rattle.intensity import natural_energy
from rattle.plot import Palette, legend_name

DIMENSIONLESS_COLUMNS = ("Impacts per forcing period", "Mean speed", "Largest speed", "Energy Σv²/2", "dB re 2π²δ²")
#: The reference of 0 dB in words: for a gear without a machine (`natural_energy`), and for a machine.
ZERO_LEVEL = "the energy of one impact of speed 2πδ in each forcing period"
ZERO_LEVEL_IN_SI = "an impact power of 1 pW"
SI_COLUMNS = ("Impacts/s", "Mean speed, m/s", "Largest speed, m/s", "J per revolution", "Power, W", "dB re 1 pW")


def intensity_table(
    attractors: Sequence[rattle.Attractor],
    found: Sequence[rattle.Intensity | None],
    delta: float,
    machine: Machine | None,
    palette: Palette,
) -> str:
    """Return an HTML table of intensities, in SI units if a machine is given. None in `found` makes a row of dashes."""
    rows = []
    for attractor, each in zip(attractors, found, strict=True):
        cells = ["–"] * len(SI_COLUMNS if machine else DIMENSIONLESS_COLUMNS)
        if each is not None:
            cells = _intensity_texts_in_si(each, machine) if machine else _dimensionless_texts(each, delta)
        rows.append((swatch_html(palette.colour(attractor)) + escape(legend_name(attractor)), *cells))
    *heads, level = SI_COLUMNS if machine else DIMENSIONLESS_COLUMNS
    zero = ZERO_LEVEL_IN_SI if machine else ZERO_LEVEL
    explained = f'<abbr title="0 dB: {zero}">{level}</abbr>'
    return folded_html_table("How hard each rattles", ("Motion", *heads, explained), rows)


def describe_loudest_motion(
    attractors: Sequence[rattle.Attractor],
    found: Sequence[rattle.Intensity | None],
    delta: float,
    machine: Machine | None,
) -> str:
    """Return a sentence on the attractor of largest impact energy; "" if no attractor is known to have impacts."""
    known = [(each, one) for each, one in zip(attractors, found, strict=True) if one is not None and one.energy > 0]
    if not known:
        return ""
    attractor, one = max(known, key=lambda pair: pair[1].energy)
    name = f"{'The loudest motion' if len(known) > 1 else 'Its rattle'}, {legend_name(attractor)},"
    if machine is not None:
        si = machine.intensity_in_si(one)
        level, speed = f"{_decibel_text(si.level)} dB re 1 pW", f"{number_text(si.mean_velocity)} m/s"
    else:
        level = f"{_decibel_text(one.level(natural_energy(delta)))} dB (0 dB is {ZERO_LEVEL})"
        speed = number_text(one.mean_speed)
    return f"{name} has {level}, and impacts of a mean speed of {speed}."


def _dimensionless_texts(found: rattle.Intensity, delta: float) -> list[str]:
    level = _decibel_text(found.level(natural_energy(delta)))
    energy = _number_and_error_text(found.energy, found.errors.energy)
    return [number_text(found.impacts), number_text(found.mean_speed), number_text(found.largest_speed), energy, level]


def _intensity_texts_in_si(found: rattle.Intensity, machine: Machine) -> list[str]:
    si = machine.intensity_in_si(found)
    numbers = [number_text(each) for each in (si.impacts, si.mean_velocity, si.largest_velocity, si.energy)]
    return [*numbers, _number_and_error_text(si.power, si.power_error), _decibel_text(si.level)]


def _decibel_text(level: float) -> str:
    """Return a level in dB as text, rounded to 0.01 dB, because rounding errors may turn 0 dB into 1e-15 dB."""
    return number_text(round(level, 2) + 0.0)


def _number_and_error_text(value: float, error: float) -> str:
    return number_text(value) + (f" ± {number_text(error, 2)}" if error > 0 else "")


class SpectrumPicture:
    """Picture of an order spectrum.

    The spectrum of a periodic or quiet motion has lines. The spectrum of a chaotic motion is a density, which is drawn
    with its 95 % interval.
    """

    def __init__(self, theme: str) -> None:
        self._theme = theme
        self.figure: Any = themed_figure(
            "spectrum", theme, "order", "force", 240, (0.0, HIGHEST_SPECTRUM_ORDER), (0.0, 1.0)
        )
        self.lines = ColumnDataSource({"x": [], "y": []})
        self._density = ColumnDataSource({"x": [], "y": [], "low": [], "high": []})
        self._drawn = [
            self.figure.segment("x", 0, "x", "y", source=self.lines, line_width=2.5),
            self.figure.line("x", "y", source=self._density, line_width=1.5),
            self.figure.varea("x", "low", "high", source=self._density, fill_alpha=0.25),
        ]

    def clear(self) -> None:
        """Remove the spectrum from the picture."""
        for source in (self.lines, self._density):
            remove_rows(source)

    def show(self, found: SpectralLines | SpectralDensity, machine: Machine | None, colour: str) -> None:
        """Draw a spectrum in a colour: in N or N²/Hz over Hz if a machine is given, else dimensionless over orders."""
        self.clear()
        hertz, newton = (machine.units.frequency, machine.units.force) if machine else (1.0, 1.0)
        x = hertz * found.order
        if isinstance(found, SpectralLines):
            y = newton * np.abs(found.amplitude)
            self.lines.data = {"x": x, "y": y}
            what = "force, N" if machine else "force"
        else:
            power = newton * newton / hertz
            y = power * found.high
            self._density.data = {
                "x": x, "y": power * found.density, "low": power * found.low, "high": power * found.high,
            }  # fmt: skip
            what = "force, N²/Hz" if machine else "force², per order"
        self.figure.xaxis.axis_label = "frequency, Hz" if machine else "order"
        self.figure.yaxis.axis_label = what
        self.figure.x_range.update(
            start=-0.01 * hertz * HIGHEST_SPECTRUM_ORDER, end=1.01 * hertz * HIGHEST_SPECTRUM_ORDER
        )
        self.figure.y_range.update(start=0.0, end=1.05 * max(float(y.max()), 1e-300))
        for each in self._drawn[:2]:
            each.glyph.line_color = line_colour(colour, self._theme)
        self._drawn[2].glyph.fill_color = colour


def spectrum_caption(found: SpectralLines | SpectralDensity, what: str) -> str:
    """Return the caption of a spectrum. what: the motion in words."""
    if isinstance(found, SpectralDensity):
        return f"Order spectrum of the force between the teeth, {what}: its density, with the 95 % interval."
    return f"Order spectrum of the force between the teeth, {what}: exact lines, at positive and negative orders."


def audio_html(file: bytes) -> str:
    """Return an audio element in HTML that contains the WAV file `file` and plays it as soon as it is shown."""
    data = b64encode(file).decode("ascii")
    return f'<audio controls autoplay src="data:audio/wav;base64,{data}"></audio>'
