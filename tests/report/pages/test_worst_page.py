from fake_flight import ENGINE, write_campaign
from search.line_flight import METRIC

from abhv_mc.report.pages.worst_page import write_worst_page
from abhv_mc.search.search_flights import SearchRequest
from abhv_mc.search.worst import WorstSettings, find_worst


def test_a_worst_case_that_ends_early_is_told_by_its_end(tmp_path):
    request = SearchRequest(write_campaign(tmp_path / "files"), tmp_path / "out")
    found = find_worst(request, WorstSettings(METRIC, flights=400), ENGINE)
    page = write_worst_page(found, tmp_path / "out/report.html").read_text(encoding="utf-8")
    end = found.flights.values[found.worst, -1]
    assert f"ended early, at {end:.4g} s" in page
    assert "worse than any value of" in page and "below, the earliest such end" in page
    assert "the flight does not end early" in page  # where sensitivities have no bar
    assert f"replay {tmp_path / 'out'} --flight {found.worst} --controller" in page


def test_what_the_search_has_in_every_flight_is_told(tmp_path):
    """A failure with a probability is searched as coming: a reader would take the worst flight for one without it."""
    sometimes = "{distribution: uniform, half_width: 10 %, probability: 12.5 %}"
    campaign = write_campaign(tmp_path / "files", dispersions=f"{{atmosphere.density: {sometimes}}}")
    found = find_worst(SearchRequest(campaign, tmp_path / "out"), WorstSettings(METRIC, flights=400), ENGINE)
    page = write_worst_page(found, tmp_path / "out/report.html").read_text(encoding="utf-8")
    assert "with a probability: atmosphere.density (12.5" in page
