"""What samples and extremes of the envelopes cost a flight: ratios of processor times, in turns.

python -m benchmarks.kernels.extremes
"""

from functools import partial
from pathlib import Path
from statistics import median

from abhv_mc.bench.speed import make_work
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.flight.fly import fly
from abhv_mc.flight.plan import Recording
from benchmarks.timing import measure_time

CAMPAIGN = Path(__file__).parents[2] / "campaigns" / "s_manoeuvre.yaml"
FLIGHTS, EVERY, REPEATS = 128, 20, 9


def main() -> None:
    """Print each controller's ratios."""
    channels = tuple(CHANNEL_INDEX[name] for name in read_campaign(CAMPAIGN).model.keep.envelopes.channels)
    kinds = {"alone": None, "samples": Recording(EVERY, channels), "extremes": Recording(EVERY, channels, True)}
    plans, parameters = make_work(FLIGHTS)
    for law, plan in plans.items():
        times: dict[str, list[float]] = {kind: [] for kind in kinds}
        for _ in range(REPEATS + 1):  # the first loads or compiles
            for kind, recording in kinds.items():
                times[kind].append(measure_time(partial(fly, plan, parameters, recording)))
        alone = median(times["alone"][1:])
        ratios = ", ".join(f"with {kind} {median(times[kind][1:]) / alone:.3f}" for kind in ("samples", "extremes"))
        print(f"{law}: {1e3 * alone / FLIGHTS:.3f} ms a flight alone; {ratios} of it")


if __name__ == "__main__":
    main()
