"""Error rates of the comparison of all pairs, and its order: python -m benchmarks.comparison

Equal controllers are compared in 400 campaigns of nine controllers, seven metrics and 300 flights,
and a closer or a more often lost controller is looked for in 400 campaigns. Then 50 random
campaigns of three to nine controllers are run and reported with the controllers in three orders;
reports differ in no number and no cell of the page, except provenance, digest and hashes.
"""

import itertools
import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.special import ndtri

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.report.numbers.report_numbers import make_numbers
from abhv_mc.report.pages.page import page_sections
from abhv_mc.statistics.winner import RISK, compare_failures, decide
from abhv_mc.topics.topic import Models

FLIGHTS, METRICS = 300, 7
APART = {"provenance", "digest"}
SIMULATOR = """
def fly(inputs, settings):
    bad, worse = inputs["a"], inputs["b"]
    values = {
        f"m{k}": settings["scale"] * abs(bad + 0.3 * k * worse + settings["offset"])
        for k in range(3)
    }
    early = bad > settings["end"]
    return {**values, "outcome": "lost" if early else "ok"}
"""


def find_beaten(rng, controllers, corrected=True):
    """Return whether a controller is beaten although all are equal."""
    shared = rng.normal(size=(1, METRICS, FLIGHTS))
    values = shared + rng.normal(size=(controllers, METRICS, FLIGHTS))
    pairs = list(itertools.combinations(range(controllers), 2))
    none = np.zeros(FLIGHTS, bool)
    family = (METRICS, len(pairs)) if corrected else (1, 1)
    return any(
        decide(values[a, m], values[b, m], none, none, family[0], pairs=family[1]).winner
        for a, b in pairs
        for m in range(METRICS)
    )


def find_closer(rng, controllers, share=0.65):
    """Return whether a controller that is closer in a share of the flights wins."""
    a, b = rng.normal(size=(2, FLIGHTS))
    none, pairs = np.zeros(FLIGHTS, bool), controllers * (controllers - 1) // 2
    shift = ndtri(share) * np.sqrt(2.0)
    return decide(a - shift, b, none, none, METRICS, pairs=pairs).winner == "a"


def find_lost(rng, share=0.03):
    """Return whether lost flights of one of two controllers are significantly more."""
    counts = compare_failures(rng.random(FLIGHTS) < share, np.zeros(FLIGHTS, bool))
    return counts.p_value <= RISK


def write_campaign(folder, rng):
    """Return the content of a random campaign; some controllers are equal, some end early."""
    (folder / "sim.py").write_text(SIMULATOR)
    kinds = [
        {"scale": float(rng.choice([1.0, 1.02, 1.3])), "offset": float(rng.choice([0.0, 0.2])),
         "end": float(rng.choice([9.0, 1.9]))}
        for _ in range(4)
    ]  # fmt: skip
    names = [f"c{k}" for k in rng.permutation(int(rng.integers(3, 10)))]
    limits = [float(rng.choice([0.0, 0.5, 3.0])) for _ in range(3)]
    return {
        "name": "order",
        "simulator": {"python": "sim.py"},
        "systems": {name: kinds[int(rng.integers(4))] for name in names},
        "under_test": sorted(names)[: int(rng.integers(1, 4))],
        "inputs": {"a": {}, "b": {}},
        "dispersions": {name: {"distribution": "normal", "sigma": 1.0} for name in ("a", "b")},
        "metrics": {f"m{k}": {} for k in range(3)},
        "outcomes": {"lost": "The flight was lost."},
        "requirements": [
            {"metric": f"m{k}", "below": limit, "probability": 0.9}
            for k, limit in enumerate(limits[: int(rng.integers(0, 4))])
        ],
        "runs": 60,
    }


def report(folder, content, order):
    """Return the numbers and the cells of the report with the systems in an order."""
    path = folder / "order.yaml"
    content = {**content, "systems": {name: content["systems"][name] for name in order}}
    path.write_text(json.dumps(content))
    read_campaign(path)
    flown = run_campaign(Request(path, folder / "-".join(order))).folder
    models = Models(read_flown(flown))
    numbers = {name: entry for name, entry in make_numbers(models).items() if name not in APART}
    cells = {
        f"{name}: {table.title}": sorted(sorted(map(str, row)) for row in table.plain_rows())
        for name, section in page_sections(models).items()
        if name not in APART
        for table in section.tables()
    }
    return json.loads(json.dumps(numbers, default=vars)), cells


def changed_by_order(seed):
    """Return the parts of a random campaign's report that change with the order of systems."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        content = write_campaign(folder, rng)
        names = list(content["systems"])
        first, *others = [
            report(folder, content, order)
            for order in (sorted(names), sorted(names)[::-1], rng.permutation(names).tolist())
        ]
        return {
            f"{seed}: {key}"
            for other in others
            for ours, theirs in zip(first, other, strict=True)
            for key in ours.keys() | theirs.keys()
            if ours.get(key) != theirs.get(key)
        }


def main():
    """Print the shares of campaigns with a finding, and the parts that depend on the order."""
    many, campaigns = (4, 1) if sys.argv[1:] == ["--smoke"] else (400, 50)
    shares = {
        "nine equal, one beaten": lambda rng: find_beaten(rng, 9),
        "the same without correction": lambda rng: find_beaten(rng, 9, corrected=False),
        "closer in 65 %, of four": lambda rng: find_closer(rng, 4),
        "closer in 65 %, of nine": lambda rng: find_closer(rng, 9),
        "3 % lost, of two": find_lost,
    }
    for label, find in shares.items():
        found = [find(np.random.default_rng([41, seed])) for seed in range(many)]
        print(f"{label:28} {np.mean(found):.3f}", flush=True)
    changed = [part for seed in range(campaigns) for part in changed_by_order(seed)]
    print(f"campaigns in three orders    {campaigns}, parts that differ: {changed or 'none'}")


if __name__ == "__main__":
    main()
