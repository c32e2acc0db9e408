"""What a verdict says in words: its counts, and what would settle what is not shown."""

from abhv_mc.statistics.verdicts import Verdict, advise


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def verdict_words(verdict: Verdict) -> str:
    """'NOT SHOWN: 1 failure in 1000 flights; extend to 2235 flights ...', all that a reader needs to weigh it."""
    words = f"{verdict.status}: {_count(verdict.failures, 'failure')} in {_count(verdict.flights, 'flight')}"
    if verdict.uncomputed:
        words += f", {verdict.uncomputed} of them not computed (failures for a PASS, successes for a FAIL)"
    parts = [words, verdict.note]
    if verdict.status == "NOT SHOWN":
        parts.append(advice_words(verdict))
    return "; ".join(part for part in parts if part)


def advice_words(verdict: Verdict) -> str:
    """To how many flights a campaign is to be extended, and how likely it passes then."""
    found = advise(verdict)
    if found is None:
        return "more of its flights failed than the requirement allows"
    most = f"at most {found.failures} of them fail" if found.failures > 1 else f"at most {found.failures} of them fails"
    condition = "none of the added flights fails" if not found.failures else most.replace("them", "the added flights")
    chance = f", {100.0 * found.chance:.2g} % at today's rate" if verdict.failures else ""
    return f"extend to {found.flights} flights (--runs {found.flights}): passes if {condition}{chance}"
