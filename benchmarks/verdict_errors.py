"""Error rates and decision rates of verdicts: python benchmarks/verdict_errors.py

Systems at the limit are judged during 100,000 flights, and good and bad systems up to 1000 and 4000
flights. Impatient users extend their campaign, pool new seeds, or follow the advice for ten rounds.
The requirement is 99.73 % at a risk of 10 %.
"""

import sys

import numpy as np

from abhv_mc.statistics import judge
from abhv_mc.statistics.evidence import flights_to_fail, flights_to_pass
from abhv_mc.statistics.verdicts import advise

AT = 0.9973, 0.10
SYSTEMS = 20_000
MOST = 450  # failures that are simulated
FAILURES = np.arange(MOST)
TO_PASS = np.array([flights_to_pass(int(k), *AT) for k in FAILURES])
TO_FAIL = np.array([flights_to_fail(int(k), *AT) for k in FAILURES + 1])


def simulate(rate, flights, seed, systems):
    """Return the shares of systems that PASS, and FAIL, at any flight up to `flights`."""
    draw = np.random.default_rng(seed)
    passed = failed = 0
    for _ in range(0, systems, 1000):
        failing_flights = np.cumsum(
            draw.geometric(rate, (1000, MOST)), axis=1
        )  # flight of each failure
        passed += np.sum(np.any((failing_flights > TO_PASS) & (flights >= TO_PASS), axis=1))
        failed += np.sum(
            np.any((failing_flights <= TO_FAIL) & (failing_flights <= flights), axis=1)
        )
    return passed / systems, failed / systems


def extend(verdict, _draw):
    """Return 1.5 times the number of flights."""
    return verdict.flights * 3 // 2


def new_seed(verdict, draw):
    """Return the number of flights with another campaign of random size."""
    return verdict.flights + int(draw.choice([500, 981, 2000]))


def follow(verdict, _draw):
    """Return the number that the report advises, or twice the number of flights."""
    advice = advise([verdict])
    return advice.flights if advice else 2 * verdict.flights


def persuade(next_flights, systems, rounds=10, seed=17):
    """Return the share of systems at the limit for which an impatient user gets a PASS."""
    draw = np.random.default_rng(seed)
    passed = 0
    for _ in range(systems):
        flights, failures = 981, int(draw.binomial(981, 1.0 - AT[0]))
        for _ in range(rounds):
            verdict = judge(failures, flights, *AT)
            if verdict.status == "PASS":
                passed += 1
                break
            extended = next_flights(verdict, draw)
            failures += int(draw.binomial(extended - flights, 1.0 - AT[0]))
            flights = extended
    return passed / systems


def main():
    """Print a line for each case."""
    few, many = (2, 1000) if sys.argv[1:] == ["--smoke"] else (5000, SYSTEMS)
    for user in (extend, new_seed, follow):
        print(f"{user.__name__:9} ten rounds: {persuade(user, few):.3f} PASS")
    for label, rate, flights in (
        ("at the limit", 1.0, 100_000),
        ("five times better", 0.2, 1000),
        ("five times better", 0.2, 4000),
        ("twice as bad", 2.0, 4000),
    ):
        passed, failed = simulate(rate * (1.0 - AT[0]), flights, 16, many)
        print(f"{label:18} up to {flights:6d} flights: PASS {passed:.3f}, FAIL {failed:.3f}")


if __name__ == "__main__":
    main()
