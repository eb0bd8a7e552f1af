"""What all pages of an application have in common."""

from __future__ import annotations

from dataclasses import dataclass

from service.explorer.common.news import News
from service.explorer.design.limits import DesignLimits
from service.explorer.map.overlays import Crises
from service.explorer.map.planes import Atlas
from service.state import Front


@dataclass(frozen=True)
class Shared:
    """What all pages of an application have in common."""

    front: Front
    news: News
    atlas: Atlas
    crises: Crises
    limits: DesignLimits
