"""The commands worst, rare, tune and compare from Python: the same work, the same pages, the same refusals."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from abhv_mc.campaign_results import CampaignResults
from abhv_mc.flying import check_count, check_mapping, to_si
from abhv_mc.io.documents import InputError, describe
from abhv_mc.io.units import FRACTION
from abhv_mc.notebook import Campaign, Paths
from abhv_mc.shipped import find_input

if TYPE_CHECKING:
    from abhv_mc.search.rare import RareFound
    from abhv_mc.search.search_flights import SearchRequest
    from abhv_mc.search.tune import TuneFound
    from abhv_mc.search.worst import WorstFound

Searched = Campaign | Paths  # read already, or a campaign file, or the name of a shipped one


def worst(
    campaign: Searched,
    output: Paths,
    metric: str,
    controller: str | None = None,
    bad: Literal["high", "low"] | None = None,
    flights: int = 2000,
    box: float = 3.0,
    seed: int | None = None,
    workers: int | None = None,
    fresh: bool = False,
) -> "WorstFound":
    """Search the box of a campaign's dispersions for the worst value of a metric, as ``abhv-mc worst`` does.

    ``bad`` values are those that the campaign takes for bad by default; ``box`` is in sigma, for unbounded
    distributions. Flights and ``report.html`` lie in ``output``; ``.numbers()`` is what ``--json`` holds. Raises
    InputError.
    """
    from abhv_mc.report.pages.worst_page import write_worst_page
    from abhv_mc.search.worst import WorstSettings, find_worst

    if bad not in ("high", "low", None):
        raise InputError("bad", describe(bad), "'high', 'low' or None")
    settings = WorstSettings(metric, bad, check_count(flights, 1, "flights"), _between("box", float(box), 0.1, 8.0))
    found = find_worst(_request(campaign, output, controller, seed, workers, fresh), settings)
    write_worst_page(found, Path(output) / "report.html")
    return found


def rare(
    campaign: Searched,
    output: Paths,
    requirement: str,
    controller: str | None = None,
    target_cov: float | str = "20 %",
    flights: int = 20_000,
    seed: int | None = None,
    workers: int | None = None,
    fresh: bool = False,
) -> "RareFound":
    """Estimate how probable it is that a flight breaks the requirement on a metric, as ``abhv-mc rare`` does.

    ``target_cov`` is the coefficient of variation to reach. Flights and ``report.html`` lie in ``output``;
    ``.numbers()`` is what ``--json`` holds: its probability is None where repetitions contradict each other
    (``.estimate.refusal`` says how). Raises InputError.
    """
    from abhv_mc.report.pages.rare_page import write_rare_page
    from abhv_mc.search.rare import RareSettings, find_rare

    cov = _between("target_cov", to_si(target_cov, FRACTION, "target_cov"), 0.01, 1.0)
    settings = RareSettings(requirement, cov, check_count(flights, 1, "flights"))
    found = find_rare(_request(campaign, output, controller, seed, workers, fresh), settings)
    write_rare_page(found, Path(output) / "report.html")
    return found


def tune(
    campaign: Searched,
    output: Paths,
    controller: str | None = None,
    block: Paths | None = None,
    seed: int | None = None,
    workers: int | None = None,
) -> "TuneFound":
    """Tune the free numbers of a controller, as ``abhv-mc tune`` does.

    ``output`` is the new controller's file, written where the result is ``.shown`` to be better within all limits; a
    page lies beside it. ``block`` is a file with the entry ``tune``, by default the campaign. ``.as_json()`` is what
    ``--json`` holds. Raises InputError.
    """
    from abhv_mc.report.pages.tune_page import write_tune_page
    from abhv_mc.search.tune import TuneFound, TuneRequest, tune_controller

    out = Path(output)
    request = TuneRequest(_path(campaign), out, controller, Path(block) if block else None, seed, workers)

    def tell(found: TuneFound) -> None:
        write_tune_page(found, out.with_suffix(".html"))

    return tune_controller(request, tell=tell)


def compare(
    a: CampaignResults | Paths,
    b: CampaignResults | Paths,
    controllers: Sequence[str] = (),
    fail_if_worse: Mapping[str, float | str] | None = None,
    output: Paths | None = None,
) -> dict[str, Any]:
    """Compare two campaigns on the same samples flight by flight: the numbers of ``abhv-mc compare --json``.

    ``controllers`` names two to compare across, the first campaign's and the second's; ``fail_if_worse`` is the share
    by which `b` may be worse in a metric, such as ``{"altitude_error_max_m": "5 %"}``. With ``output``, the page is
    written into that folder. Raises InputError.
    """
    from abhv_mc.report.numbers.compare import compare_results, parse_margins, read_compared
    from abhv_mc.report.pages.compare_page import write_compare_page

    shares = check_mapping(fail_if_worse or {}, "fail_if_worse")
    margins = parse_margins([f"{metric}={share}" for metric, share in shares.items()])
    one, other = read_compared(*(each.folder if isinstance(each, CampaignResults) else Path(each) for each in (a, b)))
    found = compare_results(one, other, controllers, margins)
    if output is not None:
        write_compare_page(one, other, found, Path(output))
    for results in (one, other):
        results.refuse_changes()
    return found


def _path(campaign: Searched) -> Path:
    return campaign.path if isinstance(campaign, Campaign) else find_input(str(campaign), "campaign")


def _request(
    campaign: Searched, output: Paths, controller: str | None, seed: int | None, workers: int | None, fresh: bool
) -> "SearchRequest":
    from abhv_mc.search.search_flights import SearchRequest

    return SearchRequest(_path(campaign), Path(output), controller, seed, workers, fresh=fresh)


def _between(name: str, value: float, low: float, high: float) -> float:
    if not low <= value <= high:
        raise InputError(name, f"{value:g}", f"a number from {low:g} to {high:g}")
    return value
