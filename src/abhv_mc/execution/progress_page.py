"""Page in a results folder that shows a run in progress and reloads itself."""

import contextlib
import time
from collections.abc import Sequence
from html import escape
from pathlib import Path

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.execution.flight_counts import Completion, judge_counts
from abhv_mc.execution.progress import Progress
from abhv_mc.io.atomic_write import atomic_write
from abhv_mc.io.messages import grouped_digits

INTERVAL = 5  # time between updates, s


class ProgressPage:
    """Page with the counts, the verdicts so far and the estimated end of a run."""

    def __init__(
        self, path: Path, campaign: Experiment, completion: Completion, progress: Progress
    ) -> None:
        self._path, self._campaign, self._completion = path, campaign, completion
        self._progress, self._written, self._is_new = progress, time.monotonic(), True

    def update(self) -> None:
        """Write the page if the last one is at least INTERVAL old; name its path once."""
        if time.monotonic() - self._written >= INTERVAL:
            self._write(f'<meta http-equiv="refresh" content="{INTERVAL}">')
            if self._is_new:
                self._progress.say(f"progress: {self._path}")
            self._written, self._is_new = time.monotonic(), False

    def close(self) -> None:
        """Write the page for the last time, without reloading, if it was written before."""
        if not self._is_new:
            self._write("")

    def _write(self, reload: str) -> None:
        counts = self._completion.all_counts
        judged = judge_counts(counts, self._campaign)
        flown = [
            (name, grouped_digits(int(self._completion.done[name].sum())), *map(
                str, (sum(own.outcomes.values()) - own.outcomes["ok"], len(own.not_computed))
            ))
            for name, own in counts.items()
        ]  # fmt: skip
        verdicts = [
            (
                own.controller,
                str(count.requirement.traced.get("id") or count.requirement.metric),
                verdict.label,
                f"{verdict.failures} of {grouped_digits(verdict.flights)}",
                f"{verdict.E_pass:.3g} of {1.0 / verdict.consumer_risk:.3g}",
                f"{verdict.E_fail:.3g} of {1.0 / verdict.producer_risk:.3g}",
            )
            for own, count, verdict, _ in judged
            if count.binds
        ]
        rate, left = self._progress.pace
        end = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(time.time() + left * bool(reload)))
        facts = [
            ("Flights of this run", " of ".join(map(grouped_digits, self._progress.counts))),
            ("Rate", f"{rate:.3g}/s"),
            ("Estimated end of the flights" if reload else "Ended", end),
        ]
        title = escape(self._campaign.name)
        heads = ("controller", "requirement", "verdict so far", "failures")
        text = (
            f'<!doctype html><html lang="en"><meta charset="utf-8">{reload}<title>{title}</title>'
            "<style>body{font:16px sans-serif;margin:2em}td,th{padding:.2em 1em;text-align:left}"
            f"</style><h1>{title}</h1>{_table((), facts)}"
            + _table(("controller", "flights", "not ok", "failed to run"), flown)
            + _table((*heads, "evidence for PASS", "evidence for FAIL"), verdicts)
            + ("" if reload else '<p><a href="report.html">report.html</a></p>')
        )
        # A full disk stops a campaign where flights are written.
        with contextlib.suppress(OSError), atomic_write(self._path) as temporary:
            temporary.write_text(text + "</html>\n", encoding="utf-8")


def _table(heads: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [("th", heads), *(("td", row) for row in rows)]
    cells = ("".join(f"<{tag}>{escape(c)}</{tag}>" for c in line) for tag, line in lines)
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in cells)}</table>"
