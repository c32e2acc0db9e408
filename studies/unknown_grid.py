"""Failures of each controller in the box of `s_manoeuvre_unknown`, on a grid of 9 x 9 x 9 values.

The grid checks independently the points at which a campaign with unknowns is judged. 1000 flights
at each value take two hours of a core; after an interruption the same command resumes.

    python studies/unknown_grid.py [--flights 1000] [--to grid.csv]
"""

import argparse
import csv
import itertools
from pathlib import Path

import numpy as np
import pandas as pd

import abhv_mc

CAMPAIGN = Path(__file__).parents[1] / "campaigns/s_manoeuvre_unknown.yaml"
HALF_WIDTHS = {"atmosphere.density": 0.10, "aero.lift": 0.10, "aero.drag": 0.15}
LIMITS = {
    "altitude_error_max_m": 50.0,
    "speed_error_max_mps": 5.0,
    "sideslip_max_deg": 1.0,
    "bank_error_settled_max_deg": 3.0,
    "angle_of_attack_error_settled_max_deg": 0.5,
}
AT_ONCE = 27  # values simulated together
CONTROLLERS = "tlc", "lqr"


def fly(
    campaign: abhv_mc.Campaign, name: str, starts: pd.DataFrame, values: np.ndarray
) -> list[list[object]]:
    """Return a row for each of ``values`` [value, unknown]: failures of each requirement."""
    table = pd.concat(
        [starts.assign(**dict(zip(HALF_WIDTHS, value, strict=True))) for value in values]
    )
    flown = abhv_mc.simulate(campaign, table.reset_index(drop=True), [name]).sel(controller=name)
    early = (flown.outcome != "ok").to_numpy()
    failed = [early | ~(flown[metric].to_numpy() < limit) for metric, limit in LIMITS.items()]
    counts = np.array(failed).reshape(len(LIMITS), len(values), -1).sum(axis=2).T
    return [
        [name, *value.tolist(), *count.tolist()]
        for value, count in zip(values, counts, strict=True)
    ]


def main() -> None:
    """Run the flights that are missing in the file, and print the failures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--flights", type=int, default=1000)
    parser.add_argument("--to", type=Path, default=Path("grid.csv"))
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    options = parser.parse_args()
    campaign = abhv_mc.Campaign.read(CAMPAIGN)
    starts = (
        campaign.draw_samples().drop(columns=list(HALF_WIDTHS)).drop_duplicates()[: options.flights]
    )
    if options.smoke:
        print(fly(campaign, CONTROLLERS[0], starts[:2], np.ones((1, len(HALF_WIDTHS)))))
        return
    lines = [np.linspace(1.0 - half, 1.0 + half, 9) for half in HALF_WIDTHS.values()]
    values = np.array(list(itertools.product(*lines)))
    rows = [(name, start) for name in CONTROLLERS for start in range(0, len(values), AT_ONCE)]
    done = len(pd.read_csv(options.to)) // AT_ONCE if options.to.exists() else 0
    with options.to.open("a", newline="") as file:
        writer = csv.writer(file)
        if not done:
            writer.writerow(["controller", *HALF_WIDTHS, *LIMITS])
        for name, start in rows[done:]:
            writer.writerows(fly(campaign, name, starts, values[start : start + AT_ONCE]))
            file.flush()
            print(f"{name}: {start + AT_ONCE} of {len(values)} values", flush=True)
    for name, failures in pd.read_csv(options.to).groupby("controller"):
        for metric in LIMITS:
            failing, most = int((failures[metric] > 0).sum()), failures[metric].max()
            print(
                f"{name} {metric}: fails at {failing} values, in at most {most} of "
                f"{len(starts)} flights"
            )


if __name__ == "__main__":
    main()
