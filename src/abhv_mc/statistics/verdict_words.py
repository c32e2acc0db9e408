"""What a verdict says in words: the risk of the rule, what is likely after the flights, and what the counts mean."""

from abhv_mc.statistics.verdicts import Verdict, runs_needed

_LEAST = 1e-6  # of the probabilities that are told as a number


def _share(value: float) -> str:
    """A probability in percent, with as many digits as tell it from 0 and 1."""
    if value in (0.0, 1.0):
        return f"{100.0 * value:g} %"
    if value < _LEAST:
        return f"less than {100.0 * _LEAST:g} %"
    digits = 2
    text = f"{100.0 * value:.{digits}g}"
    while float(text) >= 100.0 and digits < 15:
        digits += 1
        text = f"{100.0 * value:.{digits}g}"
    return f"{text} %"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def risk_words(risk: float, looks: bool = False) -> str:
    """What the consumer's risk promises: something about the rule, not about one result of it."""
    words = f"a system that just misses the requirement would PASS with a probability of at most {_share(risk)}"
    return f"{words}, however often it was looked at" if looks else words


def counts_words(verdict: Verdict, failures: int | None = None, flights: int | None = None) -> str:
    """The counts that the verdict rests on, and the campaign's where it flew on after the verdict was settled.

    `failures` in `flights` are of the whole campaign, by default those of the verdict.
    """
    words = f"{_count(verdict.failures, 'failure')} in {_count(verdict.runs, 'flight')}"
    if verdict.uncomputed:
        words += f", {verdict.uncomputed} of them flights that the machine could not compute"
    if verdict.runs and flights is not None and failures is not None and flights > verdict.runs:
        words += (
            f"; {_count(failures, 'failure')} in all {_count(flights, 'flight')}, "
            f"those after the first {verdict.runs} being no part of the verdict"
        )
    return words


def verdict_words(verdict: Verdict, failures: int | None = None, flights: int | None = None) -> str:
    """'PASS: 0 failures in 900 flights. ...' with all that a reader needs to weigh it; counts as in `counts_words`."""
    status = f"{verdict.status} (provisional)" if verdict.provisional else verdict.status
    parts = [f"{status}: {counts_words(verdict, failures, flights)}"]
    if verdict.provisional:
        parts.append("the verdict would be another one without the flights that were not computed")
    if verdict.note:
        parts.append(verdict.note)
    if verdict.met is not None:
        parts.append(
            f"after these flights the requirement is met with a probability of {_share(verdict.met)} (Jeffreys' prior)"
        )
    if verdict.status in ("NOT SHOWN", "ESTIMATE"):
        parts.append(needed_words(verdict))
    return "; ".join(part for part in parts if part)


def needed_words(verdict: Verdict) -> str:
    """What would settle the requirement, for it is not more flights of the same campaign; '' where nothing would."""
    if verdict.runs and verdict.failures / verdict.runs > 1.0 - verdict.probability:
        return "more of its flights failed than the requirement allows"
    flights = verdict.flights_needed or runs_needed(verdict.failures, verdict.probability, verdict.risk)
    most = "without a failure" if not verdict.failures else f"with at most {_count(verdict.failures, 'failure')}"
    return f"a new campaign (another seed) of {flights} flights {most} would PASS, or 'stop: when proven'"
