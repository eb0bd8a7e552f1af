"""Check where a request comes from and which host it names; refuse foreign host names and other sites' pages."""

from __future__ import annotations

import logging
import socket
from collections.abc import Collection
from ipaddress import IPv4Address, IPv6Address, ip_address
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from gear_rattle.service.errors import ForbiddenError

if TYPE_CHECKING:  # starlette is not installed without the extra for services
    from starlette.datastructures import Headers
    from starlette.types import Scope

#: Headers that proxies add, besides the headers that begin with x-forwarded.
FORWARDED = frozenset({"forwarded", "x-real-ip", "x-client-ip", "true-client-ip", "cf-connecting-ip", "via"})
WILDCARDS = ("0.0.0.0", "::")

log = logging.getLogger(__name__)


def is_loopback(host: str) -> bool:
    """Return whether an address, or every address of a host name, is a loopback address."""
    if (address := _parse_address(host)) is not None:
        return address.is_loopback
    try:
        found = [_parse_address(str(info[4][0])) for info in socket.getaddrinfo(host, None)]
    except (OSError, UnicodeError):
        return False
    return bool(found) and all(address is not None and address.is_loopback for address in found)


def is_local_request(scope: Scope, headers: Headers) -> bool:
    """Return whether a request comes from this machine and no proxy has forwarded it."""
    client = scope.get("client")
    address = _parse_address(client[0]) if client else None
    forwarded = any(name in FORWARDED or name.startswith("x-forwarded") for name in headers)
    return address is not None and address.is_loopback and not forwarded


def require_own_host(headers: Headers, host: str, allowed: Collection[str]) -> None:
    """Refuse requests that name another host than this service.

    In a DNS rebinding attack, a foreign site lets its name point to this machine. For a browser, pages of that site and
    this service then have the same origin, so the pages could use a service without keys. The attack needs a name, so a
    service that listens on all addresses may accept any IP address in the Host header.

    Raises
    ------
    ForbiddenError
        The Host header names neither loopback, nor ``host``, nor one of ``allowed``. If the service listens on all
        addresses, any IP address is allowed too.
    """
    name = _host_name(headers.get("host", ""))
    if name == "localhost" or name.endswith(".localhost") or name in {each.lower() for each in (host, *allowed)}:
        return
    address = _parse_address(name)
    if address is not None and (address.is_loopback or host in WILDCARDS):
        return
    raise ForbiddenError(
        f"This service does not answer under the name {name!r}. Use the name 127.0.0.1 or localhost, or start the "
        "service with this name in the environment variable RATTLE_ALLOWED_HOSTS."
    )


def require_same_origin(headers: Headers) -> None:
    """Refuse requests that a browser sends for a page of another site.

    The rule is that of Go's net/http.CrossOriginProtection. The header Sec-Fetch-Site decides, or the header Origin of
    older browsers. A client that sends neither is not a browser.

    Raises
    ------
    ForbiddenError
        A page of another site sent the request.
    """
    site, origin = headers.get("sec-fetch-site"), headers.get("origin")
    if site is None:
        same = origin is None or _authority_of(origin) == headers.get("host", "").lower()
    else:
        same = site in ("same-origin", "none")
    if not same:
        said = "A page of another site may not change this service. Send this request from a program."
        raise ForbiddenError(f"{said} {_host_advice(origin, headers)}" if site is None and origin else said)


def require_browser_address(headers: Headers, root: str) -> None:
    """Refuse to serve the page if it could not work at the address that the browser shows, and log what to correct.

    Parameters
    ----------
    headers : Headers
        Headers of the request for the page; a script sends the page's address in the header Rattle-Address.
    root : str
        Path of the page according to the settings of this service.

    Raises
    ------
    ForbiddenError
        A proxy publishes the page under another path than this service assumes, or sends another Host header than the
        browser, so that the page's websocket would be refused.
    """
    host, slash, path = headers.get("rattle-address", "").partition("/")
    why = ""
    there = slash + path
    if there not in ("", root):
        prefix = there.rstrip("/")
        why = f"The browser has this page at {there!r}, and the service believes that it is at {root!r}. " + (
            f"Start the service with --root-path {prefix} (RATTLE_ROOT_PATH={prefix}), or set the proxy before it to "
            f"send X-Forwarded-Prefix: {prefix}, which counts with RATTLE_BEHIND_PROXY=true."
            if prefix
            else "Start the service without --root-path and RATTLE_ROOT_PATH, or open it below its path."
        )
    elif host and host.lower() != headers.get("host", "").lower():
        why = _host_advice(host, headers)
    if why:
        log.warning("the explorer cannot be opened: %s", why)
        raise ForbiddenError(why)


def _host_advice(shown_host: str, headers: Headers) -> str:
    """Return advice for a proxy that changes the Host header. shown_host: the host or origin that the browser shows."""
    return (
        f"The browser has this page from {shown_host!r}, and the request says that its host is "
        f"{headers.get('host', '')!r}. If both are this service, set the proxy before it to pass on the Host header "
        "(nginx: proxy_set_header Host $http_host; Apache: ProxyPreserveHost On)."
    )


def _parse_address(text: str) -> IPv4Address | IPv6Address | None:
    try:
        address = ip_address(text.partition("%")[0])
    except ValueError:
        return None
    return getattr(address, "ipv4_mapped", None) or address


def _host_name(host: str) -> str:
    """Return the name in a Host header in lower case, without the port; empty if the header is invalid."""
    try:
        return (urlsplit(f"//{host}").hostname or "").removesuffix(".")
    except ValueError:
        return ""


def _authority_of(origin: str) -> str:
    """Return HOST:PORT of an origin in lower case, or HOST if it has no port; empty if the origin is invalid."""
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return ""
