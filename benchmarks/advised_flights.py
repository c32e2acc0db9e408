"""Study of the advised number of flights and its predicted chance of PASS.

    python benchmarks/advised_flights.py

True failure rates are uniform between zero and the allowed rate. The true chance is that of PASS
for all verdicts with the advised number of flights.
"""

import sys

import numpy as np
from scipy import stats

from abhv_mc.statistics.evidence import most_failures
from abhv_mc.statistics.verdicts import advise, judge

CAMPAIGNS = 4000
RISK = 0.1


def study(
    requirements: int, flights: int, probability: float, campaigns: int, seed: int = 77
) -> tuple[float, np.ndarray]:
    """Return the share of undecided campaigns with advice, and the chances [campaign, 2].

    The chances are the predicted and the true one.
    """
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
        if advice := advise(verdicts):
            most = most_failures(advice.flights, probability, RISK)
            allowed = most - np.array([verdict.failures for verdict in verdicts])
            true = np.prod(stats.binom.cdf(allowed, advice.flights - flights, rates))
            rows.append((advice.chance, true))
    return len(rows) / campaigns, np.reshape(rows, (-1, 2))


def main() -> None:
    """Print a row for each probability, number of requirements and number of flights."""
    campaigns = 3 if sys.argv[1:] == ["--smoke"] else CAMPAIGNS
    for probability in (0.9973, 0.99):
        for requirements in (1, 5):
            for flights in (500, 2000, 6000):
                answered, chances = study(requirements, flights, probability, campaigns)
                predicted, true = chances.mean(axis=0) if len(chances) else (np.nan, np.nan)
                print(
                    f"{100 * probability:g} %, {requirements} requirements, {flights} flights: "
                    f"advice in {answered:.2f} of undecided campaigns, predicted {predicted:.2f}, "
                    f"true {true:.2f}, largest predicted {chances[:, 0].max(initial=0.0):.3f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
