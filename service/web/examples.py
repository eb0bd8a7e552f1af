"""Examples for the OpenAPI document. Tests send these requests and compare the answers."""

from __future__ import annotations

from typing import Any

from rattle.models import ADDED, DEFAULT_MODEL, OTHERS
from rattle.populations import DIMENSIONLESS, OF_MACHINE

NOTHING_ADDED: dict[str, Any] = dict.fromkeys(ADDED)
SURVEY_ID = "4f1c0d9a7be25836"
SURVEY_PATH = f"/v1/surveys/{SURVEY_ID}"

REQUEST: dict[str, Any] = {
    "name": "figure 7",
    "beta": 0.6,
    "delta": {"start": 0.4, "stop": 1.0, "num": 61},
    "epsilon": {"start": 0.005, "stop": 0.3, "num": 60},
    "initial_conditions": {"count": 64, "v_max": 7.0},
    "tile": {"delta": 16, "epsilon": 16},
    "seed": 0,
}

#: A survey with a third axis: a plane for each half-backlash.
THIRD_AXIS: dict[str, Any] = {
    "name": "figure 7 for five backlashes",
    "beta": {"start": 0.5, "stop": 0.7, "num": 5},
    "delta": {"start": 0.4, "stop": 1.0, "num": 31},
    "epsilon": {"start": 0.005, "stop": 0.3, "num": 30},
}

#: A survey with impacts that lose energy, a load, and a transmission error once a tooth (20 teeth).
INELASTIC: dict[str, Any] = {
    "name": "figure 7 with losses and a mesh error",
    "model": "inelastic",
    "restitution": {"start": 0.8, "stop": 0.9, "num": 2},
    "load": 0.2,
    "harmonics": [[20, 0.0033, 0.0]],
    "delta": {"start": 0.4, "stop": 1.0, "num": 7},
    "epsilon": {"start": 0.005, "stop": 0.1, "num": 6},
    "initial_conditions": {"count": 8},
}

DESCRIPTION = {"name": "figure 7 as printed", "notes": "Beside it on the wall: the same with 512 initial conditions."}

SURVEY: dict[str, Any] = {
    "id": SURVEY_ID,
    "name": "figure 7",
    "notes": "",
    "state": "accepted",
    "progress": 0,
    "message": "",
    "created": "2026-11-21T12:00:00.000+00:00",
    "started": None,
    "finished": None,
    "content_hash": "0b6d7b7b1c6e9b8f3f4a1f1d5c3e2a998877665544332211ffeeddccbbaa0099",
    "tiles_done": 0,
    "tiles": 16,
    "cells_done": 0,
    "cells": 3660,
    "cells_failed": 0,
    "links": {
        "self": SURVEY_PATH,
        "events": f"{SURVEY_PATH}/events",
        "store": f"{SURVEY_PATH}/store",
        "map": f"{SURVEY_PATH}/map.png",
        "certificates": None,
    },
}
DETAIL: dict[str, Any] = SURVEY | {
    "request": REQUEST
    | {
        "model": DEFAULT_MODEL,
        **NOTHING_ADDED,
        "quantities": ["region", "orbits", "attractors", "lyapunov", "grazing"],
        "initial_conditions": REQUEST["initial_conditions"]
        | {"budget": 1_000_000, "tau_min": 0.0, "tau_max": 1.0, "v_min": 0.0},
        "slots": None,
        "slots_by": None,
        "harmonics": [],
        "machine": None,
        "refine": None,
        "certify": False,
    },
    "failures": [],
}
POPULATION_ID = "9a7be258364f1c0d"
POPULATION_PATH = f"/v1/populations/{POPULATION_ID}"
POPULATION_REQUEST: dict[str, Any] = {
    "name": "drawing 17",
    "gear": {
        "inertia": 0.003,
        "drag": 0.0015,
        "backlash": {"distribution": "uniform", "low": 0.00028, "high": 0.00032},
        "eccentricity": {"distribution": "normal", "mean": 0.000015, "deviation": 0.000005, "low": 0.0},
        "radius": 0.05,
        "rpm": 3000.0,
    },
    "correlation": [[1.0, 0.3], [0.3, 1.0]],
    "gears": 1000,
    "count": 4,
    "pairs": 200,
    "seed": 0,
}
POPULATION: dict[str, Any] = {
    name: value for name, value in SURVEY.items() if name not in ("id", "name", "notes", "links", "tiles", "cells")
} | {
    "id": POPULATION_ID,
    "name": "drawing 17",
    "tiles": 16,
    "cells": 2000,
    "links": {
        "self": POPULATION_PATH,
        "events": f"{POPULATION_PATH}/events",
        "store": f"{POPULATION_PATH}/store",
        "answers": f"{POPULATION_PATH}/answers",
    },
}
POPULATION_DETAIL: dict[str, Any] = POPULATION | {
    "request": POPULATION_REQUEST
    | {
        "gear": dict.fromkeys((*DIMENSIONLESS, *OF_MACHINE, "drive"))
        | POPULATION_REQUEST["gear"]
        | {"eccentricity": POPULATION_REQUEST["gear"]["eccentricity"] | {"high": None}},
        "share": None,
        "margin": None,
        "shock": None,
        "judged": 256,
        "budget": 1_000_000,
        "tile": None,
    },
    "failures": [],
}
POPULATION_LIST: dict[str, Any] = {"populations": [POPULATION], "count": 1, "next": None}
LIST: dict[str, Any] = {"surveys": [SURVEY], "count": 1, "next": None}

EVENTS = [
    {
        "id": "1",
        "event": "state",
        "data": '{"state": "accepted", "message": "", "progress": 0, "tiles_done": 0, "tiles": 16, "cells_done": 0, '
        '"cells": 3660, "at": "2026-11-21T12:00:00.000+00:00"}',
    }
]
ORBITS: dict[str, Any] = {
    "delta": 0.6,
    "epsilon": 0.1,
    "beta": 0.6,
    **NOTHING_ADDED,
    "harmonics": [],
    "region": 4,
    "region_name": "IV",
    "sn1": 0.05964305819304494,
    "flip": None,
    "quiet_limit": 0.19012105088161357,
    "missing": [
        {
            "limit": "flip",
            "reason": "none at this damping: C ends in grazing G1",
            "epsilon": 0.14445277698,
        }
    ],
    "orbits": [
        {
            "name": "A",
            "m": 1,
            "n_plus": 1,
            "n_minus": 0,
            "tau": 0.6017074510258662,
            "v": 3.7699111843077517,
            "multipliers": [{"re": 2.602048728522564, "im": 0.0}, {"re": 0.21091520311598472, "im": 0.0}],
            "stable": False,
        }
    ],
    "si": None,
}
ATTRACTORS: dict[str, Any] = {
    "delta": 0.6,
    "epsilon": 0.1,
    "beta": 0.6,
    **NOTHING_ADDED,
    "harmonics": [],
    "count": 16,
    "v_max": 7.0,
    "seed": 0,
    "budget": 1_000_000,
    "attractors": [
        {
            "kind": "quiet",
            "m": 0,
            "n_plus": 0,
            "n_minus": 0,
            "contacts": 0,
            "fraction": 0.875,
            "fraction_interval": [0.639771727342413, 0.9650225122567595],
            "lyapunov": [None, None],
            "lyapunov_error": None,
            "tau": 0.6639133779317351,
            "v": 0.6851756850681798,
        }
    ],
}
CURVES: dict[str, Any] = {
    "beta": 0.6,
    **NOTHING_ADDED,
    "window": {"delta": [0.7, 0.8], "epsilon": [0.0, 1.0]},
    "curves": [
        {
            "name": "SN1",
            "meaning": "saddle-node at which A and C, P(1,1,0), are born as ε grows; ends at COD22 (Mason "
            "and Piiroinen (2009), equation (4.1))",
            "delta": [0.7, 0.7005151168449189],
            "epsilon": [0.08100740908824863, 0.08112571577206706],
            "tau": [0.75, 0.75],
            "v": [4.39822971502571, 4.401466289617188],
            "multipliers": [[{"re": 0.9999999999999998, "im": 0.0}, {"re": 0.49658530379140964, "im": 0.0}]],
            "arclength": [0.0, 0.0005285279891881895],
            "piece": [0, 0],
            "folds": [],
            "ends": [
                {"index": 0, "reason": "window: delta = 0.7"},
                {"index": 46, "reason": "COD22: the flight after impact 0 on Σ⁺ touches Σ⁻ on its way"},
            ],
            "missing": None,
        }
    ],
    "points": [
        {
            "name": "COD20",
            "meaning": "C flips as it grazes: a multiplier is −1",
            "delta": 0.5417703613794973,
            "epsilon": 0.18323363959183087,
            "curves": ["PDC", "G1"],
            "tangency": [{"curves": ["PDC", "G1"], "order": 1.0001741238437267}],
        }
    ],
}
HEALTH: dict[str, Any] = {
    "status": "ok",
    "version": "1.0.0rc1",
    "cluster": "ready",
    "storage": "ok",
    "accepted": 2,
    "running": 1,
}
PROBLEM: dict[str, Any] = {
    "type": "about:blank",
    "title": "Unprocessable Content",
    "status": 422,
    "code": "invalid_request",
    "detail": "body.delta.num: must be at least 2, got 1",
    "instance": "/v1/surveys",
    "errors": [{"field": "body.delta.num", "message": "must be at least 2, got 1"}],
}

#: An example of each document, by the name of the document's class.
ANSWERS = {
    "SurveyDetail": DETAIL,
    "SurveyList": LIST,
    "PopulationDetail": POPULATION_DETAIL,
    "PopulationList": POPULATION_LIST,
    "OrbitsDocument": ORBITS,
    "Attractors": ATTRACTORS,
    "Curves": CURVES,
    "Health": HEALTH,
    "Problem": PROBLEM,
}


def _openapi_links(parameters: dict[str, str], *names: str) -> dict[str, Any]:
    """Return OpenAPI links to the operations `names`. parameters: {parameter: path of its value in the answer}."""
    further = {"read": {"key": "zarr.json"}}
    return {
        name: {
            "operationId": name,
            "parameters": {to: f"$response.body#/{part}" for to, part in parameters.items()} | further.get(name, {}),
        }
        for name in names
    }


def _point_links(*names: str, **parts: str) -> dict[str, Any]:
    """Return OpenAPI links to operations at a parameter point.

    parts: {parameter of the point: path of its value in the answer}. A parameter without an entry has its name as path.

    Returns
    -------
    dict[str, Any]
        The links, by the names of the operations.
    """
    return _openapi_links({name: parts.get(name, name) for name in ("delta", "epsilon", *OTHERS)}, *names)


#: Links from the document of a survey to the survey's resources, its first cell and its window.
SURVEY_LINKS = {
    **_openapi_links({"survey_id": "id"}, "show", "remove", "verify", "follow", "read", "picture"),
    **_point_links(
        *("orbits", "attractors", "basins"),
        **{name: f"request/{name}/start" for name in ("delta", "epsilon")},
        **{name: f"request/{name}" for name in OTHERS},
    ),
    **_openapi_links(
        {
            **{"delta_min": "request/delta/start", "delta_max": "request/delta/stop"},
            **{"epsilon_min": "request/epsilon/start", "epsilon_max": "request/epsilon/stop"},
            **{name: f"request/{name}" for name in OTHERS},
        },
        "curves",
    ),
}
ORBITS_LINKS = _point_links("attractors", "basins")
ATTRACTORS_LINKS = _point_links("orbits", "basins", "intensity")
#: Links from the document of curves to operations at its first codimension-two point.
CURVES_LINKS = _point_links(*("orbits", "attractors", "basins"), delta="points/0/delta", epsilon="points/0/epsilon")
