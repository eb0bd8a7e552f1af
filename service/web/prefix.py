"""The path under which a proxy publishes this service, and the scheme that browsers use."""

from __future__ import annotations

from contextvars import ContextVar

from starlette.datastructures import Headers
from starlette.responses import RedirectResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from gear_rattle.service.settings import ROOT_PATH

PREFIX_HEADER, SCHEME_HEADER = "x-forwarded-prefix", "x-forwarded-proto"
SECURE = {"http": "https", "ws": "wss"}

_root: ContextVar[str] = ContextVar("root_path", default="")


def public_path(path: str) -> str:
    """Return a path of this service as the client of the current request must request it."""
    return _root.get() + path


def route_path(scope: Scope) -> str:
    """Return the path of a request as routes know it, without the prefix of the proxy."""
    path, root = str(scope["path"]), str(scope.get("root_path", ""))
    return path.removeprefix(root) if path.startswith(f"{root}/") else path


class PrefixMiddleware:
    """Sets ``root_path`` and ``scheme`` of each request, whether the proxy removes the prefix from the path or not.

    Parameters
    ----------
    app
        Gets the requests.
    root_path
        Prefix of every request; empty if the service is at the root of a host.
    trusted
        Whether a proxy in front says prefix and scheme in ``X-Forwarded-Prefix`` and ``X-Forwarded-Proto``.
        ``root_path`` wins over the first.
    """

    def __init__(self, app: ASGIApp, root_path: str, trusted: bool) -> None:
        self.app = app
        self._root_path, self._trusted = root_path, trusted

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one ASGI connection."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        root = self._root_path or scope.get("root_path", "") or self._forwarded_prefix(headers)
        path: str = scope["path"]
        if root and path == root and scope["type"] == "http":
            query = scope["query_string"].decode("ascii", "replace")
            await RedirectResponse(f"{root}/" + (f"?{query}" if query else ""), 307)(scope, receive, send)
            return
        if not path.startswith(f"{root}/"):
            path = root + path
        scheme = scope.get("scheme", "http")
        if self._trusted and headers.get(SCHEME_HEADER, "").lower() == "https":
            scheme = SECURE.get(scheme, scheme)
        token = _root.set(root)
        try:
            await self.app({**scope, "root_path": root, "path": path, "scheme": scheme}, receive, send)
        finally:
            _root.reset(token)

    def _forwarded_prefix(self, headers: Headers) -> str:
        """Return the prefix from a trusted proxy; empty if there is none, or an invalid one."""
        said = headers.get(PREFIX_HEADER, "").rstrip("/") if self._trusted else ""
        return said if ROOT_PATH.fullmatch(said) else ""
