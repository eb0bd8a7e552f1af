"""Find out the path at which a proxy publishes this service, and the scheme (http or https) that browsers use."""

from __future__ import annotations

from contextvars import ContextVar

from starlette.datastructures import Headers
from starlette.responses import RedirectResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from gear_rattle.service.settings import ROOT_PATH

PREFIX_HEADER, SCHEME_HEADER = "x-forwarded-prefix", "x-forwarded-proto"
SECURE_SCHEMES = {"http": "https", "ws": "wss"}

_root: ContextVar[str] = ContextVar("root_path", default="")


def public_path(path: str) -> str:
    """Return a path of this service as clients must request it, with the prefix of the proxy."""
    return _root.get() + path


def path_without_prefix(scope: Scope) -> str:
    """Return the path of a request without the prefix of the proxy, as routes declare it."""
    path, root = str(scope["path"]), str(scope.get("root_path", ""))
    return path.removeprefix(root) if path.startswith(f"{root}/") else path


class PrefixMiddleware:
    """ASGI middleware that sets ``root_path`` and ``scheme`` of each request.

    A proxy in front may leave the prefix in the path or remove it.

    Parameters
    ----------
    app
        The application that gets the requests.
    root_path
        Prefix of all paths; empty if the service is at the root of a host, or if the proxy sends the prefix.
    trusted
        Use the prefix and the scheme in the headers ``X-Forwarded-Prefix`` and ``X-Forwarded-Proto``, which a proxy
        sends. A ``root_path`` has precedence over the header.
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
            scheme = SECURE_SCHEMES.get(scheme, scheme)
        token = _root.set(root)
        try:
            await self.app({**scope, "root_path": root, "path": path, "scheme": scheme}, receive, send)
        finally:
            _root.reset(token)

    def _forwarded_prefix(self, headers: Headers) -> str:
        """Return the prefix that a trusted proxy has sent; empty if there is no valid prefix."""
        said = headers.get(PREFIX_HEADER, "").rstrip("/") if self._trusted else ""
        return said if ROOT_PATH.fullmatch(said) else ""
