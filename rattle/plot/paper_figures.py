"""The registry FIGURES of the paper's figures, and the checks of their parameters.

A figure takes each of δ and ε as one number, as several numbers, or as a range (low, high); β is always one number. In
text a range is LOW:HIGH.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, NamedTuple

from rattle.errors import require, require_number, require_one_of, require_pair
from rattle.models import ADDED, Stiff, model_of_parameter
from rattle.plot import basins, diagram, plane, stiff
from rattle.plot import paper_ranges as ranges
from rattle.plot.drawing import Drawing

Given = float | Sequence[float]


class RangeArgument(NamedTuple):
    """A range that the user wrote as LOW:HIGH. Two separate numbers are a plain sequence instead."""

    low: float
    high: float


class ParameterForm(Enum):
    """The form in which a figure takes δ or ε. The value names the form in error messages."""

    NUMBER = "a number"
    NUMBERS = "one number or more"
    RANGE = "LOW:HIGH"


@dataclass(frozen=True)
class PaperFigure:
    """A figure of the paper.

    shows: the subject of the figure. delta_form, epsilon_form: the forms in which it takes δ and ε.
    delta, epsilon: the paper's values.
    draw: the function that draws it from δ, ε and β; δ and ε are a float, a tuple of floats or (low, high).
    stiff: the function that draws it for the stiff gear from δ, ε, β and κ, or None.
    """

    shows: str
    delta_form: ParameterForm
    epsilon_form: ParameterForm
    delta: Any
    epsilon: Any
    draw: Callable[[Any, Any, float], Drawing]
    stiff: Callable[[Any, Any, float, float], Drawing] | None = None


NUMBER, NUMBERS, RANGE = ParameterForm

FIGURES: dict[int, PaperFigure] = {
    4: PaperFigure(
        "basins of attraction at one δ, a panel for each ε", NUMBER, NUMBERS, *ranges.FIGURE_4, basins.panels
    ),
    5: PaperFigure(
        "one-parameter diagram along ε at one δ",
        NUMBER,
        RANGE,
        *ranges.FIGURE_5,
        diagram.draw_along_epsilon,
        diagram.draw_stiff_along_epsilon,
    ),
    6: PaperFigure(
        "basins of attraction at one point, with A to D, W^s(A), W^s(B) and Γ",
        NUMBER,
        NUMBER,
        *ranges.FIGURE_6,
        basins.draw_basins_with_manifolds,
    ),
    7: PaperFigure("bifurcation curves in the (δ, ε) plane", RANGE, RANGE, *ranges.FIGURE_7, plane.plane_figure),
    8: PaperFigure("the same curves around COD21 and COD22", RANGE, RANGE, *ranges.FIGURE_8, plane.plane_figure),
    9: PaperFigure(
        "one-parameter diagram between COD21 and COD22",
        NUMBER,
        RANGE,
        *ranges.FIGURE_9,
        diagram.draw_along_epsilon,
        diagram.draw_stiff_along_epsilon,
    ),
}


@dataclass(frozen=True)
class FigureRequest:
    """A figure of the paper with checked parameters. added: {"kappa": κ} for the stiff gear, otherwise empty."""

    number: int
    delta: Any
    epsilon: Any
    beta: float
    added: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The name of the figure's file, without suffix."""
        return f"figure{self.number}"

    @property
    def title(self) -> str:
        """The title that is shown while the figure is computed."""
        return f"Figure {self.number}, {FIGURES[self.number].shows}"

    def draw(self) -> Drawing:
        """Compute and draw the figure. Raises RattleError if it cannot be computed."""
        figure = FIGURES[self.number]
        drawn_by: Callable[..., Drawing] = figure.draw if not self.added or figure.stiff is None else figure.stiff
        return drawn_by(self.delta, self.epsilon, self.beta, **self.added)


@dataclass(frozen=True)
class StiffFigureRequest:
    """The figure that shows how the stiff gear approaches the impacting gear, with checked parameters."""

    delta: float
    epsilon: float
    beta: float
    name: str = "stiff"
    title: str = "The stiff gear and its limit"

    def draw(self) -> Drawing:
        """Compute and draw the figure. Raises RattleError if it cannot be computed."""
        return stiff.stiff_figure(self.delta, self.epsilon, self.beta)


def request(
    number: int,
    delta: Given | None = None,
    epsilon: Given | None = None,
    beta: float = ranges.BETA,
    **added: float | None,
) -> FigureRequest:
    """Return the request for a figure of the paper, by its number.

    Parameters
    ----------
    delta, epsilon : Given, optional
        One number, several numbers or a range, in the form that the figure takes; None: the paper's values.
    beta : float
        The half-backlash.
    **added : float, optional
        `kappa`, to draw the figure for the stiff gear.

    Returns
    -------
    FigureRequest
        Checked arguments; nothing is computed yet.

    Raises
    ------
    ParameterError
        If the figure does not take δ or ε in this form, or a number is outside its domain.
    """
    known = ", ".join(map(str, sorted(FIGURES)))
    require(number in FIGURES, f"Figure {number} cannot be drawn: choose one of {known}")
    figure = FIGURES[number]
    have = ", ".join(str(each) for each in sorted(FIGURES) if FIGURES[each].stiff is not None)
    given = {name: value for name, value in added.items() if value is not None}
    for name in given:
        require_one_of("a parameter", name, ADDED)
        owner = model_of_parameter(name).name
        require(
            owner == Stiff.name,
            f"the paper's figures have no {name}, which the {owner} model adds: leave it out, or draw a "
            "survey of that model",
        )
        require(
            figure.stiff is not None,
            f"Figure {number} takes no {name} ({ADDED[name].label}): leave it out, or choose one of Figures {have}",
        )
    return FigureRequest(
        number,
        figure.delta
        if delta is None
        else _check_parameter_form(number, "delta", figure.delta_form, delta, positive=True),
        figure.epsilon if epsilon is None else _check_parameter_form(number, "epsilon", figure.epsilon_form, epsilon),
        require_number("beta", beta, positive=True),
        {name: require_number(name, value, positive=True) for name, value in given.items()},
    )


def stiff_request(
    delta: Given | None = None, epsilon: Given | None = None, beta: float = ranges.BETA
) -> StiffFigureRequest:
    """Return the request for the figure that shows how the stiff gear approaches the impacting gear, at one δ and ε.

    Returns
    -------
    StiffFigureRequest
        Checked arguments; nothing is computed yet.

    Raises
    ------
    ParameterError
        If a number is outside its domain, or more than one δ or ε is given.
    """
    return StiffFigureRequest(
        stiff.DELTA if delta is None else _check_parameter_form("stiff", "delta", NUMBER, delta, positive=True),
        stiff.EPSILON if epsilon is None else _check_parameter_form("stiff", "epsilon", NUMBER, epsilon),
        require_number("beta", beta, positive=True),
    )


def draw(number: int, delta: Given | None = None, epsilon: Given | None = None, beta: float = ranges.BETA) -> Drawing:
    """Draw a figure of the paper from computed data, by its number.

    Parameters
    ----------
    delta, epsilon : Given, optional
        One number, several numbers or a range, in the form that the figure takes; None: the paper's values.
    beta : float
        The half-backlash.

    Returns
    -------
    Drawing
        The figure, and notes on parts that are left out or differ from the request.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    return request(number, delta, epsilon, beta).draw()


def parse_option(option: str, texts: Sequence[str]) -> Given | None:
    """Parse the texts of an option: numbers, or a single range LOW:HIGH.

    Returns
    -------
    Given | None
        A tuple of numbers or a range; None if there are no texts.

    Raises
    ------
    ParameterError
        If a text is neither a number nor a range, or there is a range besides other texts.
    """
    numbers = []
    for text in texts:
        try:
            parts = [float(part) for part in text.split(":")]
        except ValueError:
            parts = []
        require(len(parts) in (1, 2), f"{option} must be a number or LOW:HIGH, such as 0.1 or 0.05:0.15, got {text!r}")
        if len(parts) == 2:
            require(len(texts) == 1, f"{option} must be numbers or a single LOW:HIGH, got {' and '.join(texts)}")
            return RangeArgument(*parts)
        numbers += parts
    return tuple(numbers) or None


def _check_parameter_form(
    number: int | str, name: str, form: ParameterForm, given: Given, *, positive: bool = False
) -> Any:
    """Return δ or ε in the form that a figure takes. Raises ParameterError for another form or a value out of range."""
    values = tuple(given) if isinstance(given, Sequence) and not isinstance(given, str) else (given,)
    fits = {NUMBER: len(values) == 1, NUMBERS: len(values) >= 1, RANGE: len(values) == 2}[form]
    fits = fits and (form is RANGE or not isinstance(given, RangeArgument))
    require(fits, f"Figure {number} takes {form.value} for {name}, got {_format_option_value(given)}")
    checked = tuple(require_number(name, value, positive=positive) for value in values)
    if form is RANGE:
        low, high = require_pair(name, checked)
        require(low < high, f"{name} must be LOW:HIGH with LOW below HIGH, got {_format_option_value(given)}")
        return low, high
    return checked[0] if form is NUMBER else checked


def _format_option_value(given: Given) -> str:
    """Return the given value as text for messages: "0.6", "0.05, 0.1" for several numbers, "0.4:1.0" for a range."""
    if not isinstance(given, Sequence) or isinstance(given, str):
        return repr(given)
    return (":" if isinstance(given, RangeArgument) else ", ").join(map(str, given))
