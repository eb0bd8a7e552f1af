"""Open results from disk or from a service, with an API key if the service needs one."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from gear_rattle.service.access.origins import is_loopback
from gear_rattle.service.errors import ServiceError

if TYPE_CHECKING:
    import xarray as xr

KEY_VARIABLE, URL_VARIABLE = "RATTLE_API_KEY", "RATTLE_URL"
STORE_URL = re.compile(r"https?://[^/]+/(.*/)?v1/(surveys|populations)/[0-9a-f]+/store/?")


def api_key_headers(key: str | None = None) -> dict[str, str]:
    """Return the HTTP header with an API key. key: the key; by default the variable ``RATTLE_API_KEY``.

    Returns
    -------
    dict[str, str]
        {"Authorization": value}, or an empty dictionary if there is no key.

    Raises
    ------
    ServiceError
        The key has characters that no key can have.
    """
    key = (os.environ.get(KEY_VARIABLE, "") if key is None else key).strip()
    if not key:
        return {}
    if not (key.isascii() and key.isprintable()):
        raise ServiceError(f"The API key has invisible or non-ASCII characters. Check the key, or {KEY_VARIABLE}.")
    return {"Authorization": f"Bearer {key}"}


def open_results(store: str | Path, headers: Mapping[str, str] | None = None, group: str | None = None) -> xr.Dataset:
    """Open a survey, or a group of it, from disk or from a service.

    Parameters
    ----------
    store : str | Path
        Path or URL.
    headers : Mapping[str, str] | None
        Headers for the service. By default they contain the key of ``RATTLE_API_KEY`` if `store` is the URL of a store
        on this machine or of the service at ``RATTLE_URL``. The key is sent to no other address.
    group : str | None
        Name of a group of the store; None opens the survey itself.

    Returns
    -------
    xr.Dataset
        The dataset; its variables are read when they are needed.

    Raises
    ------
    RattleError
        There is no survey, or it cannot be read.
    ServiceError
        ``RATTLE_API_KEY`` is set, and `store` is a URL at another address, to which the key is not sent.
    """
    from gear_rattle.workers import open_survey

    if headers is None and STORE_URL.fullmatch(str(store)) and (key := api_key_headers()):
        if not _is_trusted(str(store)):
            raise ServiceError(
                f"The key in {KEY_VARIABLE} is sent only to this machine and to the address in {URL_VARIABLE}: set "
                f"{URL_VARIABLE} to the address of the service that has {store}, or unset {KEY_VARIABLE}."
            )
        headers = key
    if not headers:
        return open_survey(store, group)
    import xarray as xr

    from gear_rattle.workers.storage.complex import join_complex
    from gear_rattle.workers.storage.encoding import prepare_for_writing

    try:
        options = {"headers": dict(headers)}
        found = xr.open_zarr(str(store), chunks=None, consolidated=True, group=group, storage_options=options)
        return join_complex(prepare_for_writing(found))
    except Exception as error:  # the network or a foreign format raises errors of several types
        raise ServiceError(f"No survey can be opened at {store}: {error}") from error


def open_family(
    store: str | Path, number: int, headers: Mapping[str, str] | None = None, slice_number: int | None = None
) -> xr.Dataset:
    """Open one family of a survey as a map, like `gear_rattle.open_family`, and send an API key to a service.

    Returns
    -------
    xr.Dataset
        Variables over (epsilon, delta).

    Raises
    ------
    RattleError
        There is no survey, it has no families, or it has no family with this number.
    """
    from gear_rattle.workers.families.one import family_as_map

    return family_as_map(lambda group: open_results(store, headers, group), str(store), number, slice_number)


def _is_trusted(url: str) -> bool:
    """Return whether a URL is on this machine, or belongs to the service at ``RATTLE_URL``."""
    asked, named = urlsplit(url), urlsplit(os.environ.get(URL_VARIABLE, ""))
    # The path must match too, because a host may have other programs under other paths.
    below = asked.path.startswith(f"{named.path.rstrip('/')}/")
    return (below and (asked.scheme, asked.netloc) == (named.scheme, named.netloc)) or is_loopback(asked.hostname or "")
