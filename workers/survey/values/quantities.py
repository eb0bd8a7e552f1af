"""The registry of a survey's variables. Its entries, one for each variable, define the stores' schema, REST, documents.

To add a variable, add one `Quantity` to `QUANTITIES`. A new dimension also needs a `Coordinate`.
"""

from collections.abc import Iterable

import rattle
from gear_rattle.workers.survey.values import evaluate, intensity
from gear_rattle.workers.survey.values.cells import AUDIT, GRAZING_CURVES
from gear_rattle.workers.survey.values.schema import CELL, GROUP_NEEDS, Coordinate, Group, Quantity
from rattle.models import MODELS, Capability

DOI = "10.1137/090759641"

COORDINATES = {
    "delta": Coordinate("damping δ"),
    "epsilon": Coordinate("eccentricity ε"),
    "orbit": Coordinate("period-one orbit", ("A", "B", "C", "D")),
    "multiplier": Coordinate("number of the Floquet multiplier", (1, 2)),
    "attractor": Coordinate("slot of the attractor, by falling basin fraction"),
    "exponent": Coordinate("number of the Lyapunov exponent, by falling value", (1, 2)),
    "grazing_curve": Coordinate("grazing curve", GRAZING_CURVES),
}

_PAPER = f"doi:{DOI}"
_QUIET = f"{_PAPER} section 3.1"
_MAP = f"{_PAPER} section 3.2, equation 3.16"
_ORBITS = f"{_PAPER} section 3.3"
_BASINS = f"{_PAPER} section 5.1, Figure 4"
_PLANE = f"{_PAPER} section 5.2, Figure 7"
_WILSON = "E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209-212"
_ENTROPY = "A. Daza et al., Scientific Reports 6 (2016) 31416"
_REFINED = "docs/refined.md"
_SUM_RULE = f"tangent map of {_MAP}"

_ORBIT = ("orbit", *CELL)
_SLOT = ("attractor", *CELL)
_CURVE = ("grazing_curve", "delta")

_nan = float("nan")

#: Variables in the order in which a tile is written. `status` is last, so a tile whose status is written is complete.
QUANTITIES: tuple[Quantity, ...] = (
    Quantity(
        "region",
        Group.REGION,
        CELL,
        "int8",
        "region of the plane, by the period-one orbits that exist",
        _PLANE,
        lambda cells: cells.region,
        ("not_computed", *rattle.REGIONS[1:]),
    ),
    Quantity(
        "orbit_exists",
        Group.ORBITS,
        _ORBIT,
        "bool",
        "whether the orbit exists",
        _ORBITS,
        evaluate.orbit_evaluator("exists"),
    ),
    Quantity(
        "orbit_stable",
        Group.ORBITS,
        _ORBIT,
        "bool",
        "whether the orbit exists and is stable",
        _ORBITS,
        evaluate.orbit_evaluator("stable"),
    ),
    Quantity(
        "orbit_phase",
        Group.ORBITS,
        _ORBIT,
        "float64",
        "phase τ of the departure from Σ+, in forcing periods",
        _ORBITS,
        evaluate.orbit_evaluator("tau"),
    ),
    Quantity(
        "orbit_velocity",
        Group.ORBITS,
        _ORBIT,
        "float64",
        "speed v of the departure from Σ+",
        _ORBITS,
        evaluate.orbit_evaluator("v"),
    ),
    Quantity(
        "orbit_multiplier",
        Group.ORBITS,
        ("orbit", "multiplier", *CELL),
        "complex128",
        "Floquet multiplier of the orbit",
        _ORBITS,
        evaluate.orbit_evaluator("multipliers"),
    ),
    Quantity(
        "attractor_kind",
        Group.ATTRACTORS,
        _SLOT,
        "int8",
        "kind of attractor",
        _BASINS,
        evaluate.slot_evaluator("kind", "int8"),
        evaluate.KINDS,
    ),
    Quantity(
        "attractor_m",
        Group.ATTRACTORS,
        _SLOT,
        "int32",
        "m of P(m, n+, n-), forcing periods; 0 unless periodic",
        _ORBITS,
        evaluate.slot_evaluator("m", "int32"),
    ),
    Quantity(
        "attractor_n_plus",
        Group.ATTRACTORS,
        _SLOT,
        "int32",
        "n+ of P(m, n+, n-), impacts on or contacts with Σ+; 0 unless periodic",
        _ORBITS,
        evaluate.slot_evaluator("n_plus", "int32"),
    ),
    Quantity(
        "attractor_n_minus",
        Group.ATTRACTORS,
        _SLOT,
        "int32",
        "n- of P(m, n+, n-), impacts on or contacts with Σ-; 0 unless periodic",
        _ORBITS,
        evaluate.slot_evaluator("n_minus", "int32"),
    ),
    Quantity(
        "attractor_contacts",
        Group.ATTRACTORS,
        _SLOT,
        "int32",
        "contact phases on either wall in m forcing periods; their exponents are -infinity; 0 unless periodic",
        _ORBITS,
        evaluate.slot_evaluator("contacts", "int32"),
        needs=Capability.CONTACT_PHASES,
    ),
    Quantity(
        "attractor_fraction",
        Group.ATTRACTORS,
        _SLOT,
        "float32",
        "share of the sampled initial conditions; 0 of a stable orbit that exists and that none of them found",
        _BASINS,
        evaluate.basin_fraction_of_slots,
    ),
    Quantity(
        "attractor_fraction_upper",
        Group.ATTRACTORS,
        _SLOT,
        "float32",
        "upper end of the 95 % Wilson interval of attractor_fraction",
        _WILSON,
        evaluate.upper_fraction_limits_of_slots,
    ),
    Quantity(
        "attractor_phase",
        Group.ATTRACTORS,
        _SLOT,
        "float64",
        "phase τ of a representative point, in forcing periods",
        _MAP,
        evaluate.slot_evaluator("tau", "float64", _nan),
    ),
    Quantity(
        "attractor_velocity",
        Group.ATTRACTORS,
        _SLOT,
        "float64",
        "speed v of a representative point",
        _MAP,
        evaluate.slot_evaluator("v", "float64", _nan),
    ),
    Quantity(
        "n_attractors",
        Group.ATTRACTORS,
        CELL,
        "int16",
        "number of known attractors, also beyond the slots; undecided samples count as one",
        _BASINS,
        evaluate.attractor_count,
    ),
    Quantity(
        "unlisted_fraction",
        Group.ATTRACTORS,
        CELL,
        "float32",
        "basin fraction of the attractors beyond the slots",
        _BASINS,
        evaluate.unlisted_fraction,
    ),
    Quantity(
        "watched_periods",
        Group.ATTRACTORS,
        CELL,
        "float32",
        "shortest observation time of chaotic and undecided samples, in forcing periods; NaN if there are none",
        _BASINS,
        evaluate.shortest_observation_times,
    ),
    Quantity(
        "sampled_speed",
        Group.ATTRACTORS,
        CELL,
        "float64",
        "largest speed of the sampled initial conditions",
        _BASINS,
        lambda cells: cells.sampled_speed,
    ),
    Quantity(
        "quiet_fraction",
        Group.ATTRACTORS,
        CELL,
        "float32",
        "share of the sample that ends quiet",
        _QUIET,
        evaluate.kind_fraction_evaluator("quiet"),
    ),
    Quantity(
        "periodic_fraction",
        Group.ATTRACTORS,
        CELL,
        "float32",
        "share of the sample that ends periodic",
        _BASINS,
        evaluate.kind_fraction_evaluator("periodic"),
    ),
    Quantity(
        "chaotic_fraction",
        Group.ATTRACTORS,
        CELL,
        "float32",
        "share of the sample that ends chaotic",
        _BASINS,
        evaluate.kind_fraction_evaluator("chaotic"),
    ),
    Quantity(
        "undecided_fraction",
        Group.ATTRACTORS,
        CELL,
        "float32",
        "share of the sample left undecided",
        _BASINS,
        evaluate.kind_fraction_evaluator("undecided"),
    ),
    Quantity(
        "fraction_error",
        Group.ATTRACTORS,
        CELL,
        "float32",
        "half-width of the 95 % Wilson interval of quiet_fraction",
        _WILSON,
        evaluate.fraction_error,
    ),
    Quantity(
        "attractor_lyapunov",
        Group.LYAPUNOV,
        ("attractor", "exponent", *CELL),
        "float64",
        "Lyapunov exponent per forcing period, natural logarithm",
        _SUM_RULE,
        evaluate.slot_lyapunov_exponents,
    ),
    Quantity(
        "lyapunov_max",
        Group.LYAPUNOV,
        CELL,
        "float64",
        "largest Lyapunov exponent of the attractors that are not quiet",
        _SUM_RULE,
        evaluate.lyapunov_max,
    ),
    Quantity(
        "sum_rule_error",
        Group.LYAPUNOV,
        CELL,
        "float64",
        "largest |λ1 + λ2 + δ| of the attractors that are not quiet",
        _SUM_RULE,
        evaluate.sum_rule_error,
        needs=Capability.SUM_RULE,
    ),
    Quantity(
        "impulse_balance_error",
        Group.LYAPUNOV,
        CELL,
        "float64",
        "largest |(Σv+ − Σv-)/2πδT − 1| of the attractors that are not quiet; rounding if all are periodic",
        _MAP,
        evaluate.impulse_balance_error,
        needs=Capability.BALANCE,
    ),
    Quantity(
        "grazing_epsilon",
        Group.GRAZING,
        _CURVE,
        "float64",
        "ε on the grazing curve",
        _PLANE,
        evaluate.grazing_evaluator("epsilon"),
    ),
    Quantity(
        "grazing_phase",
        Group.GRAZING,
        _CURVE,
        "float64",
        "phase τ of the grazing orbit, in forcing periods",
        _PLANE,
        evaluate.grazing_evaluator("tau"),
    ),
    Quantity(
        "grazing_multiplier",
        Group.GRAZING,
        ("grazing_curve", "multiplier", "delta"),
        "complex128",
        "Floquet multiplier of the grazing orbit, without the square root",
        _PLANE,
        evaluate.grazing_evaluator("multipliers"),
    ),
    Quantity(
        "robust_chaos",
        Group.GRAZING,
        ("delta",),
        "bool",
        "whether δ lies inside the robust-chaos interval",
        _PLANE,
        lambda cells: cells.robust_chaos,
    ),
    Quantity(
        "basin_entropy",
        Group.BASINS,
        CELL,
        "float64",
        "basin entropy in nats, 100 x 100 cells in boxes of 5 x 5",
        _ENTROPY,
        lambda cells: cells.basin_entropy[0],
    ),
    Quantity(
        "boundary_basin_entropy",
        Group.BASINS,
        CELL,
        "float64",
        "basin entropy in nats of the boxes at basin boundaries",
        _ENTROPY,
        lambda cells: cells.basin_entropy[1],
    ),
    Quantity(
        "boundary_distance",
        Group.BASINS,
        CELL,
        "float64",
        "least impact speed that loses quiet motion; inf: none found, 0: no quiet motion",
        _QUIET,
        lambda cells: cells.boundary_distance.v,
        needs=Capability.MARGIN,
    ),
    Quantity(
        "boundary_distance_phase",
        Group.BASINS,
        CELL,
        "float64",
        "phase τ of the least impact that loses quiet motion, in forcing periods",
        _QUIET,
        lambda cells: cells.boundary_distance.tau,
        needs=Capability.MARGIN,
    ),
    Quantity(
        "crisis_side",
        Group.BASINS,
        CELL,
        "int8",
        "whether the unstable manifold of A, on the attractor's side, goes to rest in part",
        _ORBITS,
        lambda cells: cells.crisis_side,
        rattle.CRISIS_SIDES,
        Capability.CRISIS,
    ),
    *intensity.QUANTITIES,
    Quantity("status", None, CELL, "int8", "what became of the cell", "this survey", evaluate.status, evaluate.STATUS),
)


#: Additional variables of a refined survey, which are written before `status`.
REFINED: tuple[Quantity, ...] = (
    Quantity(
        "source_level",
        None,
        CELL,
        "int8",
        "0: the cell was computed; n > 0: it was filled between computed cells 2ⁿ steps apart",
        _REFINED,
        lambda cells: cells.source_level,
    ),
    Quantity(
        "audit",
        None,
        CELL,
        "int8",
        "what a computation of the cell found that was to be filled",
        _REFINED,
        lambda cells: cells.audit,
        AUDIT,
    ),
)
#: Additional variables of a refined survey that must meet a bound on the share of wrong cells.
BOUNDED: tuple[Quantity, ...] = (
    Quantity(
        "audit_leaf",
        None,
        CELL,
        "int8",
        "of a cell that was to be filled: 16 times the last such round of audits, from 0, and of the block between its "
        "computed cells the logarithm (base 2) of its side, and 8 where chaos was seen there; else 0",
        _REFINED,
        lambda cells: cells.audit_leaf,
    ),
)


def variable_groups_of_model(model: str, has_harmonics: bool = False) -> tuple[Group, ...]:
    """Return the groups of variables that a survey of a model can have; families are always among them.

    has_harmonics: whether the forcing has further harmonics. Some groups exist only for forcing by one cosine.

    Returns
    -------
    tuple[Group, ...]
        In the order of `Group`.
    """
    in_tiles = {each.group for each in QUANTITIES if each.is_in_model(model)}
    if has_harmonics:
        in_tiles -= {
            group for group, needed in GROUP_NEEDS.items() if needed in MODELS[model].capabilities_without_harmonics
        }
    return tuple(group for group in Group if group in in_tiles or group is Group.FAMILIES)


def stored_variables(groups: Iterable[Group], model: str, more: Iterable[Quantity] = ()) -> tuple[Quantity, ...]:
    """Return the variables of these groups as they are stored: a complex variable as its real and imaginary parts."""
    return tuple(part for quantity in variables_of_groups(groups, model, more) for part in quantity.parts)


def variables_of_groups(groups: Iterable[Group], model: str, more: Iterable[Quantity] = ()) -> tuple[Quantity, ...]:
    """Return the variables that a model has of these groups, then the variables `more`, and `status` last."""
    wanted = {*groups, None}
    *found, status = (each for each in QUANTITIES if each.group in wanted and each.is_in_model(model))
    return *found, *more, status


def dimension_labels(dim: str, slots: int) -> tuple[int, ...] | tuple[str, ...]:
    """Return the labels along a dimension other than δ and ε. slots: the number of slots of the survey."""
    return tuple(range(slots)) if dim == "attractor" else COORDINATES[dim].values


def shape_of_variable(quantity: Quantity, cells: tuple[int, int], slots: int) -> tuple[int, ...]:
    """Return the shape of a per-cell variable. cells: (n_epsilon, n_delta). slots: the survey's number of slots."""
    return *(len(dimension_labels(dim, slots)) for dim in quantity.dims[:-2]), *cells
