"""Log in to a service that needs keys: a form takes a key and begins a session, whose cookie the browser sends."""

from __future__ import annotations

from html import escape
from urllib.parse import parse_qs, quote

from fastapi import Request
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Route

from gear_rattle.service.access.keys import COOKIE, OLD_COOKIE, begin_session, find_key_of_token, hash_secret
from gear_rattle.service.web.prefix import public_path

LOGIN, LOGOUT = "/login", "/logout"
FORM_TYPE = "application/x-www-form-urlencoded"
MOST_FIELDS = 8  # forms with more fields are refused; the real form has one
CONTENT_SECURITY = "default-src 'none'; style-src 'unsafe-inline'; form-action 'self'; frame-ancestors 'self'"

PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>gear rattle: sign in</title><style>
:root {{ color-scheme: light dark }}
body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 28rem; margin: 12vh auto; padding: 0 1rem }}
input, button {{ font: inherit; box-sizing: border-box; width: 100%; padding: .5rem .6rem; margin: .3rem 0 1rem }}
[role=alert] {{ color: #b3261e }} @media (prefers-color-scheme: dark) {{ [role=alert] {{ color: #ff8a80 }} }}
</style></head><body><main><h1>gear rattle</h1>
<p>This service asks for an API key. <code>rattle key add NAME</code> makes one where it runs.</p>{problem}
<form method="post" action="{action}"><label>API key
<input name="key" type="password" autocomplete="current-password" required autofocus></label>
<button>Sign in</button></form></main></body></html>"""


def login_url(path: str, query: str) -> str:
    """Return the URL of the login page. A login leads to `path` with `query`, or without a query to the explorer."""
    return public_path(LOGIN) + (f"?next={quote(f'{path}?{query}', safe='')}" if query else "")


def _url_after_login(request: Request) -> str:
    """Return the URL of the page to show after the login, which is never a page of another site."""
    wanted = request.query_params.get("next", "")
    return public_path(wanted if wanted.startswith("/?") and wanted.isprintable() else "/")


def _render_login_page(request: Request, problem: str = "", status: int = 200) -> Response:
    action = public_path(LOGIN) + (f"?{request.url.query}" if request.url.query else "")
    alert = f'<p role="alert">{escape(problem)}</p>' if problem else ""
    headers = {"Content-Security-Policy": CONTENT_SECURITY, "Cache-Control": "no-store"}
    return HTMLResponse(PAGE.format(problem=alert, action=escape(action)), status, headers)


async def login(request: Request) -> Response:
    """Return the login form, or begin a session if the submitted form has a valid key."""
    if request.method == "GET":
        had = request.state.caller is None and not {COOKIE, OLD_COOKIE}.isdisjoint(request.cookies)
        response = _render_login_page(request, "Your session has ended: sign in again." if had else "")
        _delete_cookie(request, response, OLD_COOKIE)
        return response
    if request.headers.get("content-type", "").partition(";")[0].strip().lower() != FORM_TYPE:
        raise HTTPException(415, f"Send the form as {FORM_TYPE}.")
    try:
        fields = parse_qs((await request.body()).decode("utf-8", "replace"), max_num_fields=MOST_FIELDS)
    except ValueError:
        raise HTTPException(422, "This form has too many fields: send only the field named key.") from None
    token = fields.get("key", [""])[0].strip()
    front = request.app.state.front
    if (key := await run_in_threadpool(find_key_of_token, front.database, token)) is None:
        return _render_login_page(request, "This API key is unknown or was revoked.", 401)
    session = await run_in_threadpool(begin_session, front.database, key, front.settings.session_seconds)
    response = RedirectResponse(_url_after_login(request), 303)
    here = public_path("/")  # the cookie's path, so that other programs of this host do not get the cookie
    response.set_cookie(COOKIE, session, httponly=True, samesite="strict", secure=_is_https(request), path=here)
    _delete_cookie(request, response, OLD_COOKIE)
    return response


async def logout(request: Request) -> Response:
    """End the session of this browser only."""
    if session := request.cookies.get(COOKIE):
        await run_in_threadpool(request.app.state.front.database.end_session, hash_secret(session))
    response = RedirectResponse(public_path(LOGIN), 303)
    _delete_cookie(request, response, COOKIE)
    _delete_cookie(request, response, OLD_COOKIE)
    return response


def _delete_cookie(request: Request, response: Response, cookie: str) -> None:
    if cookie in request.cookies:
        path = "/" if cookie == OLD_COOKIE else public_path("/")
        response.delete_cookie(cookie, httponly=True, samesite="strict", secure=_is_https(request), path=path)


def _is_https(request: Request) -> bool:
    # A proxy sets this header. A client that forges it only prevents its own cookie from being sent unencrypted.
    return request.url.scheme == "https" or request.headers.get("x-forwarded-proto", "").lower() == "https"


ROUTES = (
    Route(LOGIN, login, methods=["GET", "POST"], include_in_schema=False),
    Route(LOGOUT, logout, methods=["POST"], include_in_schema=False),
)
