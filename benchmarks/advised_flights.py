"""How often the advised number of flights suffices, and the chance that is said: python benchmarks/advised_flights.py

True failure rates are uniform between zero and the allowed one. The true chance is that all verdicts are PASS with the
advised number of flights.
"""

import sys

import numpy as np
from scipy import stats

from abhv_mc.statistics.evidence import most_failures
from abhv_mc.statistics.verdicts import advise, judge

CAMPAIGNS = 200
RISK = 0.1


def study(
    requirements: int, flights: int, probability: float, campaigns: int, seed: int = 5
) -> tuple[float, np.ndarray]:
    """Return the share of open campaigns that get a number, and their said and true chances [campaign, 2]."""
    draw = np.random.default_rng(seed)
    rows, open_campaigns = [], 0
    while open_campaigns < campaigns:
        rates = draw.uniform(0.0, 1.0 - probability, requirements)
        verdicts = [
            judge(int(failures), flights, probability, RISK)
            for failures in draw.binomial(flights, rates)
        ]
        statuses = {verdict.status for verdict in verdicts}
        if "NOT SHOWN" not in statuses or "FAIL" in statuses:
            continue
        open_campaigns += 1
        if found := advise(verdicts):
            most = most_failures(found.flights, probability, RISK)
            allowed = most - np.array([verdict.failures for verdict in verdicts])
            true = np.prod(stats.binom.cdf(allowed, found.flights - flights, rates))
            rows.append((found.chance, true))
    return len(rows) / campaigns, np.reshape(rows, (-1, 2))


def main() -> None:
    """Print a row of each probability, number of requirements and number of flights."""
    campaigns = 3 if sys.argv[1:] == ["--smoke"] else CAMPAIGNS
    for probability in (0.9973, 0.99):
        for requirements in (1, 5):
            for flights in (500, 2000, 6000):
                answered, chances = study(requirements, flights, probability, campaigns)
                said, true = chances.mean(axis=0) if len(chances) else (np.nan, np.nan)
                print(
                    f"{100 * probability:g} %, {requirements} requirements, {flights} flights: a number in "
                    f"{answered:.2f} of open campaigns, said {said:.2f}, true {true:.2f}, "
                    f"largest said {chances[:, 0].max(initial=0.0):.3f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
