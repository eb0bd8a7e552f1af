"""What a service says of itself: its REST calls and its documents, in a browser that reaches no other host."""

import pytest
from explorer_support import assert_accessible, open_view, visiting
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


def test_help_is_a_drawer_that_leads_to_all_documents(browser: Browser, service: str) -> None:
    with visiting(browser, service) as context:
        page = context.new_page()
        open_view(page, service)
        drawer = page.get_by_role("dialog", name="Help")
        for shut in ("Escape", "Close"):
            page.get_by_role("button", name="Help", exact=True).click()
            expect(drawer.get_by_role("heading", name="What is good")).to_be_visible()
            assert_accessible(page)
            if shut == "Escape":
                page.keyboard.press(shut)
            else:
                drawer.get_by_role("button", name=shut).click()
            expect(drawer).to_be_hidden()
        page.get_by_role("button", name="Help", exact=True).click()
        with context.expect_page() as opened:
            drawer.get_by_role("link", name="All documents").click()
        documents = opened.value
        expect(documents.get_by_role("heading", name="gear-rattle")).to_be_visible()
        documents.get_by_role("link", name="The explorer", exact=True).click()
        expect(documents.get_by_role("heading", name="The explorer", exact=True)).to_be_visible()
        expect(drawer).to_be_visible()  # on the page, which is still there
