"""Describe one parameter point in words and tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape
from urllib.parse import urlencode

import rattle
from gear_rattle.service.explorer.common.address import Pair
from gear_rattle.service.explorer.design.extents import (
    CRISIS,
    FLIP,
    GRAZING,
    LOST,
    MOST_FOLLOWED,
    QUIET_LIMIT,
    RANGE,
    SADDLE_NODE,
    SWEPT,
    ExtentEnd,
    MotionExtent,
)
from gear_rattle.service.explorer.design.fields import ERRORS
from gear_rattle.service.explorer.point.parts import PeriodOneOrbits, QuietMargin, SampledAttractors
from gear_rattle.service.harmonics import harmonic_texts
from rattle import Machine
from rattle.models import AnyGear, model_of_gear
from rattle.orbits import region_in_words
from rattle.parameters import Harmonic
from rattle.plot import Palette, legend_name

MINUS = "\N{MINUS SIGN}"
LEAST_WRITTEN_SHARE = 5e-4  # a share between 0 and this number is written as "less than 0.05 %"
MOST_HARMONICS = 6  # most harmonics that a sentence lists
MOST_NAMED = 6  # most attractors that are named below the bar of basin fractions
ROWS = 6  # rows of a table that are shown before a viewer unfolds it
PERIOD, REVOLUTION = "forcing period", "revolution"
#: Words for the event at an end of the range of ε in which a motion attracts. BEGINS: lower end. ENDS: upper end.
BEGINS = {SADDLE_NODE: "begins by a saddle-node", FLIP: "begins by period doubling", GRAZING: "begins at a graze"}
ENDS = {
    SADDLE_NODE: "ends by a saddle-node",
    FLIP: "ends by period doubling",
    GRAZING: "ends at a graze",
    CRISIS: "ends in the boundary crisis",
    QUIET_LIMIT: "ends at the quiet limit",
}


def number_text(value: float, digits: int = 4) -> str:
    """Return a number as text, with `digits` significant digits and a true minus sign; a dash for NaN."""
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else f"{MINUS}∞"
    return f"{value:.{digits}g}".replace("-", MINUS)


def count_in_words(count: int, noun: str) -> str:
    """Return a count with its noun: 1 event, 2 events."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def period_name(machine: Machine | None) -> str:
    """Return "revolution" if the forcing period is one revolution of the machine, else "forcing period"."""
    return REVOLUTION if machine is not None and machine.revolutions == 1 else PERIOD


def repetition_in_words(count: int, period: str) -> str:
    """Return how often a motion repeats: "every revolution", or "every 3 revolutions" for a count of 3."""
    return f"every {period}" if count == 1 else f"every {count_in_words(count, period)}"


def percent_text(share: float) -> str:
    """Return a share in per cent, with three significant digits. Only exactly 0 and 1 become 0 % and 100 %."""
    if 0 < share < LEAST_WRITTEN_SHARE:
        return "less than 0.05 %"
    if 1 - LEAST_WRITTEN_SHARE <= share < 1:
        return "at least 99.95 %"
    return f"{100 * share:.3g} %"


def complex_number_text(value: complex, digits: int = 4) -> str:
    """Return a complex number as text. An imaginary part of the size of rounding errors is left out."""
    if abs(value.imag) < 1e-12 * max(1.0, abs(value.real)):
        return number_text(value.real, digits)
    sign = "+" if value.imag > 0 else MINUS
    return f"{number_text(value.real, digits)} {sign} {number_text(abs(value.imag), digits)}i"


def multipliers_text(values: tuple[complex, complex] | None) -> str:
    """Return two Floquet multipliers as text, in the form a ± bi if they are conjugate; a dash for None."""
    if values is None:
        return "–"
    first, second = values
    if first.imag and abs(first - second.conjugate()) < 1e-9:
        return f"{number_text(first.real)} ± {number_text(abs(first.imag))}i"
    return f"{complex_number_text(first)}, {complex_number_text(second)}"


def motion_in_words(attractor: rattle.Attractor, letter: str = "", period: str = PERIOD) -> str:
    """Return a phrase for a motion that is not quiet, such as "1 impact every revolution, P(1,1,0)"."""
    if attractor.kind == "chaotic":
        return "chaotic, without a period"
    if attractor.kind == "undecided":
        return "undecided"
    impacts = attractor.n_plus + attractor.n_minus
    held = f" and {count_in_words(attractor.contacts, 'contact phase')}" if attractor.contacts else ""
    often = repetition_in_words(attractor.m, period)
    return f"{count_in_words(impacts, 'impact')}{held} {often}, {name_with_letter(attractor, letter)}"


def swatch_html(colour: str) -> str:
    """Return a small square of a colour, in HTML, for legends and tables."""
    return f'<span class="swatch" style="background:{colour}"></span>'


def name_with_letter(attractor: rattle.Attractor, letter: str) -> str:
    """Return the label or the kind of an attractor, followed by its letter A to D unless `letter` is ""."""
    return f"{legend_name(attractor)} = {letter}" if letter else legend_name(attractor)


def point_in_words(gear: AnyGear) -> str:
    """Return in words the parameters of a gear, and the region of its point in the plane."""
    at = f"Damping δ = {number_text(gear.delta, 6)}, eccentricity ε = {number_text(gear.epsilon, 6)}"
    backlash = f", half-backlash β = {number_text(gear.beta, 6)}"
    model = model_of_gear(gear)
    for each in model.added:
        backlash += f", {each.list_item_text} = {number_text(model.numbers[each.name], 6)}"
    if harmonics := gear.parameters.harmonics:
        backlash += f", {harmonics_in_words(harmonics)}"
    backlash += f": {region_in_words(gear.region())}." if model.has_closed_forms else "."
    return f"{at}{backlash}"


def quiet_limit_in_words(gear: AnyGear, period: str = PERIOD) -> str:
    """Describe the ε up to which quiet running is possible and, if it is known, the ε at which P(1,1,0) begins."""
    if gear.epsilon >= gear.quiet_limit:
        quiet = (
            f"The gear cannot run quietly here: above an eccentricity of {number_text(gear.quiet_limit)} the teeth "
            "must separate."
        )
    else:
        quiet = f"Quiet running is possible here, and up to an eccentricity of {number_text(gear.quiet_limit)}."
    born = gear.sn1 if model_of_gear(gear).has_closed_forms else None
    if born is not None and gear.epsilon < born:
        return f"{quiet} Rattle with one impact every {period}, P(1,1,0), begins at ε = {number_text(born)}."
    return quiet


def harmonics_in_words(harmonics: Sequence[Harmonic]) -> str:
    """Return in words the orders, amplitudes (relative to the first harmonic) and phases (in turns) of harmonics."""
    few = [f"{order}: {number_text(size)} at {number_text(phase)}" for order, size, phase in harmonics[:MOST_HARMONICS]]
    more = len(harmonics) - len(few)
    return f"harmonic{'s' * (len(harmonics) > 1)} {'; '.join(few)}{f'; and {more} more' if more else ''}"


def machine_in_words(machine: Machine, gear: AnyGear) -> str:
    """Return a machine in words, with the model's units of speed and energy in SI units."""
    units = machine.units
    quiet = gear.quiet_limit * units.length
    more = "" if machine.stiffness is None else f", a mesh stiffness of {number_text(machine.stiffness)} N/m"
    more += "" if machine.load_torque is None else f", a load of {number_text(machine.load_torque)} N m"
    errors = [number_text(1e6 * size) for size in (getattr(machine, name) for name in ERRORS) if size]
    more += f", mesh errors of {', '.join(errors)} µm" if errors else ""
    alike = ", if all errors grow in proportion" if gear.parameters.harmonics else ""
    eccentricity = number_text(1e6 * machine.eccentricity)
    return (
        f"A machine at {number_text(machine.rpm, 6)} rpm with an eccentricity of {eccentricity} µm"
        f"{more}: quiet running is possible up to {number_text(1e6 * quiet)} µm{alike}. A speed of 1 is "
        f"{number_text(units.velocity)} m/s along the line of action, an energy v²/2 of 1 is "
        f"{number_text(units.energy)} J."
    )


def likelihood_in_words(gear: AnyGear, found: SampledAttractors, period: str = PERIOD) -> str:
    """Return in sentences how likely the gear is to run quietly, and with which motions it rattles otherwise."""
    pairs = list(zip(found.attractors, found.letters, strict=True))
    quiet, undecided = (next((x for x, _ in pairs if x.kind == kind), None) for kind in ("quiet", "undecided"))
    rattling = [(each, letter) for each, letter in pairs if each.kind in ("periodic", "chaotic")]
    # upper end of the 95 % interval of the basin fraction of a motion that no sample reached
    below = percent_text(float(rattle.wilson_interval(0, found.starts)[1]))
    sentences = []
    if quiet:
        low, high = (percent_text(x) for x in quiet.fraction_interval)
        likely = f"From a random start the gear runs quietly in {percent_text(quiet.fraction)} of cases"
        sentences.append(f"{likely} (95 % interval {low} to {high}, from {count_in_words(found.starts, 'start')}).")
    elif gear.epsilon >= gear.quiet_limit:
        sentences.append("From every start the gear rattles: it never comes to rest against the teeth.")
    else:
        none = f"None of {found.starts:,} random starts came to run quietly"
        sentences.append(f"{none}: the probability is below {below}.")
    if rattling:
        said = "; ".join(
            f"{motion_in_words(each, letter, period)} ({percent_text(each.fraction)})" for each, letter in rattling[:4]
        )
        more = f"; and {len(rattling) - 4} more" if len(rattling) > 4 else ""
        sentences.append(f"{'Otherwise it' if quiet else 'It'} rattles: {said}{more}.")
    elif quiet and not undecided:
        sentences.append(f"No start came to rattle: the probability of rattle is below {below}.")
    if undecided:
        sentences.append(f"The outcome of {percent_text(undecided.fraction)} of the starts is undecided.")
    return " ".join(sentences)


def margin_in_words(gear: AnyGear, found: QuietMargin, period: str = PERIOD) -> str:
    """Return in words the least impact that ends quiet running, and the motion to which this impact leads."""
    if gear.epsilon >= gear.quiet_limit:
        return "There is no quiet running that an impact could end: the margin is 0."
    if math.isnan(found.v):
        return "This close to the quiet limit it cannot be computed which impacts end quiet running."
    if math.isinf(found.v):
        return f"No impact slower than {number_text(found.v_max)} was found that ends quiet running."
    leads = motion_in_words(found.leads_to, period=period) if found.leads_to is not None else "rattle"
    sentence = (
        f"The margin of quiet running is an impact of speed {number_text(found.v)}: weaker impacts die out, and an "
        f"impact of this speed at phase {number_text(found.tau, 3)} sets off the nearest rattle ({leads})."
    )
    if found.undecided < found.v:
        sentence += f" From speed {number_text(found.undecided)} on the outcome of some impacts is undecided."
    return sentence


def basin_fractions_bar_html(found: SampledAttractors, palette: Palette) -> str:
    """Return the basin fractions as one bar in HTML, with the first MOST_NAMED attractors named below it."""
    named = [
        (palette.colour(each), f"{name_with_letter(each, letter)} {percent_text(each.fraction)}", each.fraction)
        for each, letter in zip(found.attractors, found.letters, strict=True)
    ]
    pieces = "".join(f'<span style="flex-grow:{share:.6f};background:{shade}"></span>' for shade, _, share in named)
    names = [f"<li>{swatch_html(shade)}{escape(said)}</li>" for shade, said, _ in named[:MOST_NAMED]]
    if len(named) > MOST_NAMED:
        left = sum(share for _, _, share in named[MOST_NAMED:])
        names.append(f"<li>and {len(named) - MOST_NAMED} more, {percent_text(left)} in all</li>")
    said = escape("; ".join(said for _, said, _ in named))
    return (
        f'<div class="shares" role="img" aria-label="Shares of starts: {said}">{pieces}</div>'
        f'<ul class="legend" aria-label="Shares of starts">{"".join(names)}</ul>'
    )


def folded_html_table(caption: str, heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table in HTML, with rows after the sixth folded. The first cell of a row is its head. Cells are HTML."""
    head = "".join(f'<th scope="col">{each}</th>' for each in heads)
    lines = []
    for first, *rest in rows:
        cells = "".join(f"<td>{each}</td>" for each in rest)
        lines.append(f'<tr><th scope="row">{first}</th>{cells}</tr>')
    fold = f"<details><summary>All {len(lines)} rows</summary></details>" if len(lines) > ROWS else ""
    body = "".join(lines)
    name = escape(caption)
    table = f"<table><caption>{name}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    # on a phone a table may be wider than the screen: the keyboard can scroll it too
    return f'<div class="rows" role="group" aria-label="{name}" tabindex="0">{fold}{table}</div>'


def orbits_table(found: PeriodOneOrbits) -> str:
    """Return a table in HTML of the period-one orbits A to D that exist at a point."""
    if not found.orbits:
        return "<p>None of the period-one orbits A to D exists here.</p>"
    rows = (
        (
            orbit.name,
            legend_name((orbit.m, orbit.n_plus, orbit.n_minus)),
            "stable" if orbit.stable else "unstable",
            number_text(orbit.tau),
            number_text(orbit.v),
            multipliers_text(orbit.multipliers),
        )
        for orbit in found.orbits
    )
    return folded_html_table(
        f"Period-one orbits: {region_in_words(found.region)}",
        ("Orbit", "Type", "Stability", "Phase τ", "Speed v", "Multipliers"),
        rows,
    )


def notebook_link(gear: AnyGear, direction: str, span: float | None, to: Pair | None) -> str:
    """Return an HTML link to a notebook that computes attractors, basins and the shown diagram of a point.

    direction, span, to: the choice of the diagram, as in `PointTabsState`.

    Returns
    -------
    str
        The link.
    """
    at = gear.parameters.point()
    along = {"direction": direction, "span": span} if to is None else {"to_delta": to[0], "to_epsilon": to[1]}
    harmonics = [("harmonic", each) for each in harmonic_texts(gear.parameters.harmonics)]
    asked = (*at.items(), *along.items(), *harmonics)
    query = urlencode([(name, value) for name, value in asked if value is not None])
    link = f'<a href="v1/notebook?{escape(query)}" download>A notebook</a>'
    return f'<p class="faint">{link} computes what is shown here.</p>'


def attractors_table(found: SampledAttractors, palette: Palette) -> str:
    """Return a table in HTML of the attractors with their basin fractions, Lyapunov exponents and multipliers."""
    rows = []
    for each, letter, multipliers in zip(found.attractors, found.letters, found.multipliers, strict=True):
        low, high = each.fraction_interval
        error = f" ± {number_text(each.lyapunov_error, 2)}" if each.lyapunov_error > 0 else ""
        rows.append(
            (
                f"{swatch_html(palette.colour(each))}{escape(name_with_letter(each, letter))}",
                f"{percent_text(each.fraction)} <small>({percent_text(low)} to {percent_text(high)})</small>",
                f"{number_text(each.lyapunov[0])}{error}",
                number_text(each.lyapunov[1]),
                multipliers_text(multipliers),
            )
        )
    heads = ("Motion", "Share of starts (95 %)", "Exponent λ₁", "λ₂", "Multipliers")
    return folded_html_table(f"Attractors from {count_in_words(found.starts, 'start')}", heads, rows)


def value_with_error_text(value: float, error: float) -> str:
    """Return "value ± error", the error rounded up at its first digit or to an integer; "value" for an error of 0."""
    if error == 0.0:
        return number_text(value)
    places = max(0, -math.floor(math.log10(error)))
    return f"{value:.{places}f} ± {math.ceil(error * 10**places) / 10**places:.{places}f}".replace("-", MINUS)


def extent_end_in_words(end: ExtentEnd, is_upper: bool, scale: float = 1.0) -> str:
    """Return in words one end of the range of ε in which a motion attracts, and the event there.

    Parameters
    ----------
    end : ExtentEnd
        The end.
    is_upper : bool
        True for the end at the larger eccentricity.
    scale : float
        Factor from ε to the unit that is shown.

    Returns
    -------
    str
        The end in words, such as "0.05964: begins by a saddle-node (SN1)".
    """
    at, side = value_with_error_text(scale * end.epsilon, scale * end.error), "above" if is_upper else "below"
    if end.kind == RANGE:
        return f"does not end up to {at}" if is_upper else at
    if end.kind == LOST:
        return f"{at}: could not be followed farther"
    if end.kind == SWEPT:
        return f"{at} (swept); {side} it the sweep found {end.motion_beyond}"
    if end.kind == FLIP and end.remains:
        what = "loses stability by period doubling" if is_upper else "becomes stable by period doubling"
    else:
        what = (ENDS if is_upper else BEGINS)[end.kind]
    more = (
        f" ({end.curve})"
        if end.curve
        else f" ({side}, {end.motion_beyond})"
        if end.motion_beyond and end.kind == GRAZING
        else ""
    )
    return f"{at}: {what}{more}"


def extents_table(
    found: SampledAttractors, extents: Sequence[MotionExtent | None], machine: Machine | None, palette: Palette
) -> str:
    """Return a table of the eccentricities between which each attractor attracts, with the event at each end.

    Parameters
    ----------
    found : SampledAttractors
        The attractors of the point.
    extents : sequence of MotionExtent or None
        The extents of the first attractors; None for the entry of undecided samples, and for an extent that was not
        computed in time.
    machine : Machine | None
        Machine whose eccentricities are shown, in µm; None for ε.
    palette : Palette
        Colours of the motions.

    Returns
    -------
    str
        The table in HTML.
    """
    scale, unit = (1.0, "ε") if machine is None else (1e6 * machine.units.length, "µm")
    rows = []
    for each, letter, extent in zip(found.attractors, found.letters, extents, strict=False):
        swatch = f'<span class="swatch" style="background:{palette.colour(each)}"></span>'
        ends = ("–", "–")
        if extent is not None:
            ends = extent_end_in_words(extent.low, False, scale), extent_end_in_words(extent.high, True, scale)
            seen = f", with {count_in_words(extent.windows, 'periodic window')}" if extent.windows else ""
            ends = ends[0], ends[1] + seen
        rows.append((f"{swatch}{escape(name_with_letter(each, letter))}", *map(escape, ends)))
    few = f" (the {MOST_FOLLOWED} with the largest basins)" if len(found.attractors) > MOST_FOLLOWED else ""
    caption = f"Where each motion begins and ends as the eccentricity grows{few}"
    return folded_html_table(caption, ("Motion", f"From {unit}", f"To {unit}"), rows)


#: The beginning or the end of chaos: name of the event, name of the motion, point (δ, ε), and ε as text.
ChaosEvent = tuple[str, str, Pair, str]


def chaos_events(
    gear: AnyGear, attractors: Sequence[rattle.Attractor], extents: Sequence[MotionExtent | None]
) -> list[ChaosEvent]:
    """Return the beginning and the end along ε of each chaotic attractor as events.

    Both events are left out if the extent of the attractor is None. The beginning is left out if chaos lasts down to
    the lower limit of the range that was swept, and the end if chaos lasts up to the upper limit.

    Returns
    -------
    list[ChaosEvent]
        At most two events for each chaotic attractor.
    """
    return [
        (what, legend_name(each), (gear.delta, end.epsilon), value_with_error_text(end.epsilon, end.error))
        for each, extent in zip(attractors, extents, strict=False)
        if each.kind == "chaotic" and extent is not None
        for what, end in (("beginning of chaos", extent.low), ("end of chaos", extent.high))
        if end.kind in (SWEPT, CRISIS)
    ]
