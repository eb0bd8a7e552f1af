"""What a service says of itself: its REST calls and its documents, in a browser that reaches no other host."""

import pytest
from explorer_support import visiting
from playwright.sync_api import Browser, expect


@pytest.mark.parametrize(
    ("path", "shown"),
    [
        ("/docs", "Sum of impact speeds|The attractors at a parameter point|/v1/attractors"),
        ("/redoc", "/v1/attractors"),
        ("/help/", "Surveys of the damping-eccentricity plane"),
        ("/help/explorer.md", "shows a page at"),
    ],
)
def test_the_reference_is_there_without_any_other_host(browser: Browser, service: str, path: str, shown: str) -> None:
    with visiting(browser, service) as context:  # which fails where a page asks for anything elsewhere, or complains
        page = context.new_page()
        page.goto(service + path)
        expect(page.get_by_text(shown.split("|")[-1]).first).to_be_visible()
        page.wait_for_load_state("networkidle")


def test_the_page_leads_to_its_help(browser: Browser, service: str) -> None:
    with visiting(browser, service) as context:
        page = context.new_page()
        page.goto(service)
        page.get_by_role("link", name="Help").click()
        expect(page.get_by_role("heading", name="gear-rattle")).to_be_visible()
        page.get_by_role("link", name="explorer").first.click()
        expect(page.get_by_role("heading", name="The explorer")).to_be_visible()
