"""Results do not depend on the order of the controllers in the campaign file."""

import pytest
from report.synthetic import write_campaign

from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.report.numbers.report_numbers import make_numbers
from abhv_mc.report.pages.page import page_sections
from abhv_mc.topics.topic import Models

APART = {"provenance", "digest"}
LIMITS = (50, 0, 0.7)
METRICS = ("altitude_error_max_m", "speed_error_max_mps", "sideslip_max_deg")
REQUIREMENTS = tuple(
    f"{{metric: {metric}, below: {limit}, probability: 0.9}}"
    for metric, limit in zip(METRICS, LIMITS, strict=True)
)
ORDERS = (("tlc", "lqr", "lqr_retuned", "slow"), ("slow", "lqr_retuned", "tlc", "lqr"))


@pytest.mark.parametrize("requirements", [REQUIREMENTS, ()])
def test_numbers_and_cells_are_equal_in_every_order(tmp_path, requirements):
    contents = []
    for k, order in enumerate(ORDERS):
        folder = write_campaign(
            tmp_path / str(k) / "c",
            controllers=order,
            requirements=requirements,
            failing=9,
            under_test="[lqr, tlc]",
        )
        models = Models(read_flown(folder))
        numbers = {name: n for name, n in make_numbers(models).items() if name not in APART}
        cells = {
            (name, table.title): sorted(map(sorted, table.plain_rows()))
            for name, section in page_sections(models).items()
            if name not in APART
            for table in section.tables()
        }
        contents.append((numbers, cells))
    assert contents[0][1] == contents[1][1]
    for name, entry in contents[0][0].items():
        assert entry == contents[1][0][name], name
