"""A page on a network that runs in a thread, and a browser."""

import shutil
from importlib.util import find_spec

import pytest

from running_page import Running


@pytest.fixture(scope="session")
def websockets():
    if find_spec("websockets") is None:
        pytest.skip("websockets is not installed: pip install '.[live]'")


@pytest.fixture(scope="module")
def running(websockets):
    one = Running()
    yield one
    one.close()


@pytest.fixture
def client(running):
    with running.client() as one:
        yield one


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    """Chromium, steered by selenium."""
    if find_spec("selenium") is None:
        pytest.skip("selenium is not installed")
    programs = [shutil.which(name) for name in ("chromium", "chromedriver")]
    if None in programs:
        pytest.skip("no chromium and chromedriver on PATH")
    from selenium import webdriver
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service

    options = Options()
    options.binary_location = programs[0]
    for word in ("headless=new", "no-sandbox", "disable-gpu", "hide-scrollbars", "disable-dev-shm-usage"):
        options.add_argument(f"--{word}")
    folder = str(tmp_path_factory.mktemp("downloads"))
    options.add_experimental_option("prefs", {"download.default_directory": folder})
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    one = webdriver.Chrome(options=options, service=Service(programs[1]))
    yield one
    one.quit()
