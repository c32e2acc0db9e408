"""Synthetic campaigns and their reports, each made once."""

import json

import pytest
from report.browser import open_browser
from report.synthetic import write_campaign

from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.report.pages.build import build_report
from abhv_mc.topics.topic import Models


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Open a page in a browser, if one is installed."""
    with open_browser(tmp_path_factory.mktemp("browser") / "profile") as page:
        yield page


@pytest.fixture(scope="session")
def report_folder(tmp_path_factory):
    """Write a campaign of 80 flights with its report."""
    folder = write_campaign(tmp_path_factory.mktemp("whole") / "a campaign", runs=80)
    build_report(folder)
    return folder


@pytest.fixture(scope="session")
def models(report_folder):
    return Models(read_flown(report_folder))


@pytest.fixture(scope="session")
def report_page(report_folder):
    return (report_folder / "report.html").read_text("utf-8")


@pytest.fixture(scope="module")
def report_json(report_folder):
    return json.loads((report_folder / "report.json").read_text("utf-8"))
