"""Compare pinned points side by side: as a table, and as CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import rattle
from gear_rattle.service.explorer.common.address import Pin
from gear_rattle.service.explorer.point.parts import SampledAttractors, add_orbit_letters, sampled_attractors
from gear_rattle.service.explorer.point.words import harmonics_in_words, name_with_letter, number_text, percent_text
from gear_rattle.service.harmonics import harmonic_texts
from rattle.models import ADDED, model_of_gear
from rattle.orbits import region_in_words
from rattle.plot import legend_name

HEADER = (
    "delta", "epsilon", "beta", *ADDED, "harmonics", "region", "quiet_limit", "starts", "attractor", "kind", "letter",
    "m", "n_plus", "n_minus", "contacts", "fraction", "fraction_low", "fraction_high", "lyapunov_1",
    "lyapunov_1_error", "lyapunov_2", "tau", "v",
)  # fmt: skip
COMPUTED = "computing …"
RATTLING = ("periodic", "chaotic")


class PinResults(NamedTuple):
    """Results of a pinned point: the number of its region, its quiet limit, its attractors.

    The region is None if the forcing has harmonics, because regions are defined for a forcing of one cosine.
    """

    region: int | None
    quiet_limit: float
    found_attractors: SampledAttractors


def compute_pin_results(pin: Pin, count: int) -> PinResults:
    """Return the results of a pinned point from `count` initial conditions. It is slow: use another process."""
    gear = pin.model.gear(pin.delta, pin.epsilon)
    found = sampled_attractors(gear, count)
    if gear.parameters.harmonics:
        return PinResults(None, gear.quiet_limit, found)
    if not model_of_gear(gear).has_closed_forms:
        found = add_orbit_letters(found, gear.orbits())
    return PinResults(gear.region(), gear.quiet_limit, found)


def build_pin_table(pins: Sequence[Pin], results: Mapping[Pin, PinResults | str]) -> list[list[str]]:
    """Return the lines of the table, each with its head and a cell for each pin.

    Parameters
    ----------
    results : Mapping[Pin, PinResults | str]
        Results of each pin, or the message if its computation failed; a pin without an entry is being computed.

    Returns
    -------
    list[list[str]]
        Texts of the cells, line by line.
    """
    lines = [
        ["Damping δ", *(number_text(each.delta, 6) for each in pins)],
        ["Eccentricity ε", *(number_text(each.epsilon, 6) for each in pins)],
        ["Half-backlash β", *(number_text(each.beta, 6) for each in pins)],
    ]
    for name, parameter in ADDED.items():
        values = [dict(each.added).get(name) for each in pins]
        if any(value is not None for value in values):
            head = f"{parameter.label.capitalize()} {parameter.symbol}"
            lines.append([head, *("–" if value is None else number_text(value, 6) for value in values)])
    if any(each.harmonics for each in pins):
        lines.append(["Forcing", *(harmonics_in_words(each.harmonics) if each.harmonics else "–" for each in pins)])
    of_pins = [results.get(each, COMPUTED) for each in pins]
    lines.append(["Region", *(each if isinstance(each, str) else _region_name(each) or "–" for each in of_pins)])
    all_known = [each if isinstance(each, PinResults) else None for each in of_pins]
    lines.append(["Quiet up to ε", *(number_text(each.quiet_limit) if each else "" for each in all_known)])
    lines.append(["Largest λ₁ of rattling", *(_largest_exponent_text(each) if each else "" for each in all_known)])
    names = dict.fromkeys(name for each in all_known if each for name, _ in _named_motions(each))
    return lines + [[name, *(_fractions_and_exponents_text(each, name) for each in all_known)] for name in names]


def _region_name(results: PinResults) -> str:
    """Return the region of a pinned point in words; "" if the results have none."""
    return "" if results.region is None else region_in_words(results.region)


def _named_motions(results: PinResults) -> list[tuple[str, rattle.Attractor]]:
    """Return (name, attractor) of each attractor. If an attractor is a motion A to D, its name includes the letter."""
    pairs = zip(results.found_attractors.attractors, results.found_attractors.letters, strict=True)
    return [(name_with_letter(each, letter), each) for each, letter in pairs]


def _largest_exponent_text(results: PinResults) -> str:
    """Return the largest Lyapunov exponent of the periodic and chaotic attractors as text; a dash if there are none."""
    rattling = (each.lyapunov[0] for each in results.found_attractors.attractors if each.kind in RATTLING)
    return number_text(max(rattling, default=math.nan))


def _fractions_and_exponents_text(results: PinResults | None, name: str) -> str:
    """Return fractions and exponents of a point's attractors with this name; a dash for none, "" without results."""
    if results is None:
        return ""
    return "; ".join(_fraction_text(each) for called, each in _named_motions(results) if called == name) or "–"


def _fraction_text(attractor: rattle.Attractor) -> str:
    low, high = attractor.fraction_interval
    exponent = f", λ₁ {number_text(attractor.lyapunov[0])}" if attractor.kind in RATTLING else ""
    return f"{percent_text(attractor.fraction)} ({percent_text(low)}–{percent_text(high)}){exponent}"


def csv_text(pins: Sequence[Pin], results: Mapping[Pin, PinResults | str]) -> str:
    """Return CSV with a line for each attractor of each pin whose results are known.

    Numbers have all their digits, so that they are read back to the same bits.

    Returns
    -------
    str
        The CSV text, with a header.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADER)
    for pin in pins:
        if not isinstance(found := results.get(pin), PinResults):
            continue
        added = (dict(pin.added).get(name, "") for name in ADDED)
        here = *pin[:3], *added, " ".join(harmonic_texts(pin.harmonics)), _region_name(found), found.quiet_limit
        for each, letter in zip(found.found_attractors.attractors, found.found_attractors.letters, strict=True):
            writer.writerow(
                (
                    *here, found.found_attractors.starts, legend_name(each), each.kind, letter,
                    each.m, each.n_plus, each.n_minus, each.contacts, each.fraction, *each.fraction_interval,
                    each.lyapunov[0], each.lyapunov_error, each.lyapunov[1], each.tau, each.v,
                )
            )  # fmt: skip
    return text.getvalue()
