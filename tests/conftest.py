"""Fixtures that more than one test file needs."""

from collections.abc import Callable, Iterator

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

import app  # noqa: F401  # says where kernels are cached, which must come before numba
from tests.browser import LAUNCH_ARGS, find_or_install


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    executable = find_or_install()
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=executable, args=LAUNCH_ARGS)
        yield chromium
        chromium.close()


@pytest.fixture
def open_page(browser: Browser) -> Iterator[Callable[..., Page]]:
    """`open_page(url, **context_options)`: each page in a context of its own, its console free of errors.

    A test that expects errors there says so with `console_errors_allowed=True`.
    """
    contexts, errors = [], []

    def open_page(url: str, *, console_errors_allowed: bool = False, **context_options) -> Page:
        contexts.append(context := browser.new_context(**context_options))
        page = context.new_page()
        if not console_errors_allowed:
            page.on("pageerror", lambda error: errors.append(str(error)))
            page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
        page.goto(url)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert not errors, "the browser's console shows errors"
