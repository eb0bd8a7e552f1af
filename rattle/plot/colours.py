"""A colour for each type of motion, the same in every picture.

The types are P(m, n₊, n₋). Quiet motion has the bright yellow that means quiet on maps of the quiet fraction, and no
other motion has a colour near it. Colours of other motions follow the words of the paper about its Figures 4 to 6, with
two exceptions: P(4,4,2), yellow in the paper, has the paper's dark blue of quiet motion; and P(8,8,6), which the paper
calls dark orange like P(2,2,2), is dark brown. The colours of Figure 4 are as different as these words allow, for
deuteranopes too. At weak damping a picture may have so many types that two of them would look alike; then the type that
is drawn later gets another colour in this picture (`Palette`).
"""

import colorsys
from collections import Counter
from functools import cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.table import KINDS, Attractor
from rattle.errors import require, require_integer

Label = tuple[int, int, int]

#: Colours of motions that are not periodic. Quiet motion has the colour at the upper end of matplotlib's viridis, in
#: which the quiet fraction is drawn.
KIND_COLOURS = {"quiet": "#fde725", "chaotic": "#d7191c", "undecided": "#9a9a9a"}
#: {label (m, n₊, n₋) of a type of periodic motion: its fixed colour}. All other types get their colours by a rule.
NAMED: dict[Label, str] = {
    (1, 1, 0): "#8ec7ea",  # light blue
    (1, 1, 1): "#fbd4b1",  # light orange
    (2, 2, 2): "#ff6a00",  # dark orange
    (3, 3, 3): "#267359",
    (4, 4, 2): "#17386e",  # dark blue
    (5, 5, 2): "#6677cc",
    (8, 8, 6): "#39240e",
}
#: Colours of `rattle.REGIONS`. Deuteranopes can distinguish III and V. Regions that the paper does not name have light
#: colours that are as different as possible.
REGION_COLOURS = (
    "#e8e8e8", "#f4efe3", "#bfdcec", "#60b8a8", "#f2c879", "#d88870", "#5999d9", "#bf73a6", "#59e5e5", "#998c59",
    "#599999", "#d9b2f2", "#59ccf2", "#bfcc7f", "#8c8c7f", "#f28ca6", "#7f8ca6", "#669959",
)  # fmt: skip
#: Ranges of hues in degrees for all types that are not in NAMED: green to teal, and purple to pink. In NAMED only the
#: colour of (3, 3, 3) has such a hue.
HUES = ((100.0, 175.0), (265.0, 335.0))
SATURATION, LIGHTNESS = 0.65, (0.25, 0.75)
#: Changes of hue and of lightness per unit of m, n₊ and n₋, as shares of the ranges of hue and lightness. They were
#: found by trial, so that the types of Figure 4 and the types at 500 random points of the plane differ most.
HUE_STEPS, LIGHTNESS_STEPS = (0.753, 0.439, 0.588), (0.127, 0.726, 0.28)
#: Largest accepted number m, n₊ or n₋ of a label.
LARGEST_LABEL_NUMBER = 10**9
#: Distance in CIELAB below which two colours look alike.
ALIKE = 15.0
#: Least distance in CIELAB of a spare colour from the colour of quiet motion.
LEAST_QUIET_DISTANCE = 75.0
#: Spare colours (hue, lightness, saturation), for types whose own colour looks like another colour in the picture.
SPARE = tuple(product(np.arange(0.0, 360.0, 12.0), (0.28, 0.42, 0.56, 0.7, 0.82), (0.35, 0.6, 0.9)))

#: Matrix from linear sRGB to CIE XYZ.
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)

Motion = Attractor | Label | str


def _motion_type(motion: Motion) -> str | Label:
    """Return the type of a motion: "quiet", "chaotic", "undecided" or (m, n₊, n₋). Raises ParameterError."""
    if isinstance(motion, Attractor):
        motion = (motion.m, motion.n_plus, motion.n_minus) if motion.kind == "periodic" else motion.kind
    if isinstance(motion, str):
        known = ", ".join(kind for kind in KINDS if kind in KIND_COLOURS)
        require(motion in KIND_COLOURS, f"motion must be one of {known} or (m, n_plus, n_minus), got {motion!r}")
        return motion
    require(
        isinstance(motion, tuple) and len(motion) == 3,
        f"motion must be an Attractor, a kind or (m, n_plus, n_minus), got {motion!r}",
    )
    m, n_plus, n_minus = motion
    return (
        require_integer("m", m, 1, LARGEST_LABEL_NUMBER),
        require_integer("n_plus", n_plus, 1, LARGEST_LABEL_NUMBER),
        require_integer("n_minus", n_minus, 0, LARGEST_LABEL_NUMBER),
    )


def legend_name(motion: Motion, contacts: int | None = None) -> str:
    """Return the name of a motion in a legend: P(m,n₊,n₋), or P(m,n₊,n₋;c) with c contact phases, or its kind.

    Parameters
    ----------
    motion : Attractor, (m, n_plus, n_minus) or str
        The motion.
    contacts : int, optional
        The number c of contact phases of the motion. None: the field `contacts` of `motion`, or 0 if it has no such
        field.

    Returns
    -------
    str
        "P(m,n₊,n₋)" or "P(m,n₊,n₋;c)" of a periodic motion, else "quiet", "chaotic" or "undecided".

    Raises
    ------
    ParameterError
        If `motion` is not an attractor, a kind or a valid label (m, n_plus, n_minus).
    """
    label = _motion_type(motion)
    if isinstance(label, str):
        return label
    phases = getattr(motion, "contacts", 0) if contacts is None else contacts
    return f"P({','.join(map(str, label))}{f';{phases}' if phases else ''})"


def legend_sort_key(motion: Motion) -> tuple[int, tuple[int, ...]]:
    """Return the sort key of a motion: quiet first, then periodic by (m, n₊, n₋), then chaotic, then undecided."""
    label = _motion_type(motion)
    return (KINDS.index(label), ()) if isinstance(label, str) else (KINDS.index("periodic"), label)


def colour(motion: Motion) -> str:
    """Return the colour of a type of motion, which depends on the type alone.

    Parameters
    ----------
    motion : Attractor, (m, n_plus, n_minus) or str
        The motion, or its kind "quiet", "chaotic" or "undecided".

    Returns
    -------
    str
        The colour as "#rrggbb".

    Raises
    ------
    ParameterError
        If `motion` is not an attractor, a kind or a valid label (m, n_plus, n_minus).
    """
    label = _motion_type(motion)
    if isinstance(label, str):
        return KIND_COLOURS[label]
    return NAMED.get(label) or _colour_by_rule(label)


class Palette:
    """The colours of the motions in one picture.

    A type has the colour that `colour` returns, unless this colour looks like a colour that the picture already has, or
    like the colour of quiet, chaotic or undecided motion. Then the type has the spare colour that differs most from all
    of these colours.

    alike: the distance in CIELAB below which the colour of a type not in NAMED looks like another colour. For the types
    in NAMED this distance is always ALIKE.
    """

    def __init__(self, alike: float = ALIKE) -> None:
        self._alike = alike
        self._taken: dict[str | Label | tuple[str | Label, int], str] = {}
        self._taken.update(KIND_COLOURS)
        self._times: Counter[str | Label] = Counter()

    def colour(self, motion: Motion) -> str:
        """Return the colour "#rrggbb" of a type of motion in this picture. Raises ParameterError."""
        label = _motion_type(motion)
        if label not in self._taken:
            own = colour(motion)
            taken = np.array([_cielab_coordinates(each) for each in self._taken.values()])
            least = ALIKE if label in NAMED else self._alike
            near = np.hypot.reduce(taken - _cielab_coordinates(own), axis=1).min() < least
            self._taken[label] = self._farthest_spare_colour() if near else own
        return self._taken[label]

    def next_colour(self, motion: Motion) -> str:
        """Return the colour of one more motion of a type, for a picture with several motions of one type.

        The first motion of a type has the colour of the type, and each further motion has a spare colour.

        Returns
        -------
        str
            The colour as "#rrggbb".

        Raises
        ------
        ParameterError
            If `motion` is not an attractor, a kind or a valid label (m, n_plus, n_minus).
        """
        label = _motion_type(motion)
        self._times[label] += 1
        if self._times[label] == 1:
            return self.colour(motion)
        return self._taken.setdefault((label, self._times[label]), self._farthest_spare_colour())

    def _farthest_spare_colour(self) -> str:
        """Return the spare colour farthest from the picture's colours and those of quiet, chaotic, undecided motion."""
        taken = np.array([_cielab_coordinates(each) for each in self._taken.values()])
        away = [float(np.hypot.reduce(taken - each, axis=1).min()) for _, each in _spare_colours()]
        return _spare_colours()[int(np.argmax(away))][0]


@cache
def _spare_colours() -> tuple[tuple[str, NDArray[np.float64]], ...]:
    """Return the spare colours that differ enough from the colour of quiet motion, as "#rrggbb" and in CIELAB."""
    found = (_hex_colour(hue, lightness, saturation) for hue, lightness, saturation in SPARE)
    every, quiet = [(each, _cielab_coordinates(each)) for each in found], _cielab_coordinates(KIND_COLOURS["quiet"])
    return tuple((each, lab) for each, lab in every if np.hypot.reduce(lab - quiet) >= LEAST_QUIET_DISTANCE)


def _cielab_coordinates(shade: str) -> NDArray[np.float64]:
    """Return the CIELAB coordinates (3,) of an sRGB colour "#rrggbb" (CIE 1976, white point D65).

    In these coordinates, pairs of colours at equal distances look about equally different.

    Returns
    -------
    NDArray[np.float64]
        L*, a* and b*.
    """
    rgb = np.array([int(shade[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    xyz = XYZ @ linear / XYZ.sum(axis=1)
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def _colour_by_rule(label: Label) -> str:
    """Return the colour of a type that is not in NAMED; m, n₊ and n₋ determine its hue and its lightness."""
    hue = _fractional_sum(label, HUE_STEPS) * sum(high - low for low, high in HUES)
    for low, high in HUES:
        if hue < high - low:
            break
        hue -= high - low
    dark, light = LIGHTNESS
    return _hex_colour(low + hue, dark + _fractional_sum(label, LIGHTNESS_STEPS) * (light - dark), SATURATION)


def _hex_colour(hue: float, lightness: float, saturation: float) -> str:
    """Return a colour as "#rrggbb"; the hue is in degrees, lightness and saturation are from 0 to 1."""
    rgb = colorsys.hls_to_rgb(hue / 360, lightness, saturation)
    return "#" + "".join(f"{round(255 * part):02x}" for part in rgb)


def _fractional_sum(label: Label, steps: tuple[float, ...]) -> float:
    """Return the fractional part of steps[0]·m + steps[1]·n₊ + steps[2]·n₋."""
    return sum(n * step for n, step in zip(label, steps, strict=True)) % 1.0
