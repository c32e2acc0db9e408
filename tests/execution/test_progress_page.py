"""The page of a run in progress states the counts so far, and does not reload after the end."""

import re

import pytest
from fake_flight import ENGINE, interrupted_after, run, write_campaign

from abhv_mc.execution import progress_page
from abhv_mc.execution.progress import Progress
from abhv_mc.folder.hashes import find_damage
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import read_manifest


@pytest.mark.parametrize("blocks", [7, None])
def test_the_page_of_a_run(tmp_path, monkeypatch, capfd, blocks):
    monkeypatch.setattr(progress_page, "INTERVAL", 0)
    pages = []
    write = progress_page.ProgressPage._write
    monkeypatch.setattr(
        progress_page.ProgressPage,
        "_write",
        lambda page, reload: (write(page, reload), pages.append(page._path.read_text())),
    )
    risks = "consumer_risk: 0.2, producer_risk: 0.1"
    limit = f"[{{metric: altitude_error_max_m, below: 50, probability: 0.9, {risks}}}]"
    campaign = write_campaign(
        tmp_path / "files", execution="{workers: 2, batch: 50}", requirements=limit
    )
    result = run(campaign, tmp_path / "out", interrupted_after(blocks) if blocks else ENGINE)
    folder = CampaignFolder(result.folder)
    assert capfd.readouterr().err.count(str(folder.progress)) == 1
    counts = [
        sum(int(count) for count in re.findall(r"<tr><td>(?:one|two)</td><td>(\d+)</td>", page))
        for page in pages
    ]
    assert counts == sorted(counts) and counts[-1] == sum(
        sum(own.outcomes.values()) for own in result.manifest.controllers.values()
    )
    assert all(("refresh" in page) == (page is not pages[-1]) for page in pages)
    verdict = result.manifest.requirements[0]
    counted = f"<td>{verdict.failures} of {verdict.flights}</td>"
    assert re.search(rf"{counted}<td>\S+ of 5</td><td>\S+ of 10</td>", pages[-1])
    assert not list(find_damage(folder, read_manifest(folder.manifest)))


def test_the_pace_is_that_of_the_remaining_steps():
    progress = Progress("flights", 4)
    progress._start -= 10.0
    progress.add(1)
    assert progress.pace == pytest.approx((0.1, 30.0), rel=0.01)
