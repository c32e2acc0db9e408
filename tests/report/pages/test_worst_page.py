from fake_flight import ENGINE, write_campaign
from search.line_flight import METRIC

from abhv_mc.report.pages.worst_page import write_worst_page
from abhv_mc.search.search_flights import SearchRequest
from abhv_mc.search.worst import WorstSettings, find_worst


def test_what_the_search_has_in_every_flight_is_told(tmp_path):
    """A failure with a probability is searched as coming: a reader would take the worst flight for one without it."""
    sometimes = "{distribution: uniform, half_width: 10 %, probability: 12.5 %}"
    campaign = write_campaign(tmp_path / "files", dispersions=f"{{atmosphere.density: {sometimes}}}")
    found = find_worst(SearchRequest(campaign, tmp_path / "out"), WorstSettings(METRIC, flights=400), ENGINE)
    page = write_worst_page(found, tmp_path / "out/report.html").read_text(encoding="utf-8")
    assert "with a probability: atmosphere.density (12.5" in page
