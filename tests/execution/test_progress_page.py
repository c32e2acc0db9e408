"""The page of a run in progress states the counts so far, and does not reload after the end."""

import re
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
from fake_flight import ENGINE, interrupted_after, run, write_campaign

from abhv_mc.execution import progress_page
from abhv_mc.execution.progress import Progress
from abhv_mc.execution.progress_page import ProgressPage
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


@pytest.mark.parametrize("reload", ["<meta>", ""])
def test_each_cell_of_the_page_is_a_count_or_a_judgement(tmp_path, monkeypatch, reload):
    outcomes = Counter(ok=2500, lost=30, failed_to_run=4)
    own = SimpleNamespace(controller="one", outcomes=outcomes, not_computed=[1, 2, 3, 4])
    rest = SimpleNamespace(controller="<two>", outcomes=Counter(lost=2), not_computed=[])
    completion = SimpleNamespace(
        all_counts={"one": own, "<two>": rest},
        done={"one": np.arange(3000) < 2534, "<two>": np.arange(3000) < 2},
    )
    verdict = SimpleNamespace(
        label="PASS*", failures=34, flights=2530, E_pass=12.345, E_fail=0.0123456,
        consumer_risk=0.1, producer_risk=0.05,
    )  # fmt: skip

    def count(binds, **traced):
        requirement = SimpleNamespace(traced=traced, metric="miss")
        return SimpleNamespace(requirement=requirement, binds=binds)

    counts = [(own, count(True, id="R1")), (own, count(False, id="R2")), (rest, count(True))]
    judged = [(*pair, verdict, 0) for pair in counts]
    monkeypatch.setattr(progress_page, "judge_counts", lambda *_: judged)
    monkeypatch.setattr(progress_page.time, "time", lambda: 1e6)
    monkeypatch.setattr(progress_page.time, "localtime", lambda seconds: seconds)
    monkeypatch.setattr(progress_page.time, "strftime", lambda layout, time: f"at {time:.0f}")
    progress = SimpleNamespace(pace=(12.54, 40.0), counts=(300, 6000))
    page = ProgressPage(tmp_path / "p.html", SimpleNamespace(name="a & b"), completion, progress)
    page._write(reload)
    text = (tmp_path / "p.html").read_text("utf-8").replace("\u202f", "")
    rows = [re.findall(r"<t[dh]>(.*?)</t[dh]>", row) for row in text.split("<tr>")[1:]]
    facts, flown, verdicts = rows[:4], rows[4:7], rows[7:]
    end = "at 1000040" if reload else "at 1000000"
    assert [row[1] for row in facts[1:]] == ["300 of 6000", "12.5/s", end]
    assert flown[1:] == [["one", "2534", "34", "4"], ["&lt;two&gt;", "2", "2", "0"]]
    numbers = ["PASS*", "34 of 2530", "12.3 of 10", "0.0123 of 20"]
    assert verdicts[1:] == [["one", "R1", *numbers], ["&lt;two&gt;", "miss", *numbers]]
    assert "<title>a &amp; b</title>" in text
    assert ("<meta>" in text) != ('href="report.html"' in text) == (not reload)
