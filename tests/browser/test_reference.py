"""What a service says of itself: its REST calls and its documents, in a browser that reaches no other host."""

import pytest
from explorer_support import visiting
from playwright.sync_api import Browser, expect


@pytest.mark.parametrize(
    ("path", "shown"),
    [
        ("/docs", "/v1/surveys/{survey_id}/map.png"),
        ("/redoc", "Download OpenAPI specification"),
        ("/help/", "Surveys of the damping-eccentricity plane"),
        ("/help/explorer.md", "shows a page at"),
    ],
)
def test_the_reference_is_there_without_any_other_host(browser: Browser, service: str, path: str, shown: str) -> None:
    # which fails where a page asks for anything elsewhere, or complains; ReDoc would like its makers' logo, and may not
    with visiting(browser, service, allowed=("redoc/logo-mini.svg",)) as context:
        context.route(lambda url: not url.startswith(service), lambda route: route.abort())
        page = context.new_page()
        answer = page.goto(service + path)
        assert answer is not None
        assert "img-src 'self' data:" in answer.headers["content-security-policy"]
        expect(page.get_by_text(shown).first).to_be_visible()
        page.wait_for_load_state("networkidle")


def test_the_page_leads_to_its_help(browser: Browser, service: str) -> None:
    with visiting(browser, service) as context:
        page = context.new_page()
        page.goto(service)
        page.get_by_role("link", name="Help").click()
        expect(page.get_by_role("heading", name="gear-rattle")).to_be_visible()
        page.get_by_role("link", name="explorer").first.click()
        expect(page.get_by_role("heading", name="The explorer")).to_be_visible()
