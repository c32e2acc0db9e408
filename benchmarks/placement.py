"""Error rates and power of tests of flights, and of `identify`.

Usage: python benchmarks/placement.py [--smoke]

All models are cheap functions of arrays, with fixed seeds:

- sets of flights with six metrics (linear in five dispersions, and one lognormal), grouped by
  vehicles with a share of the variance;
- point masses in a glide, with records of speed and angle of attack.

The last part estimates parameters of the TLC in the S manoeuvre from histories of the plant.
"""

import sys
from collections.abc import Iterator

import numpy as np

from abhv_mc.statistics.identification import estimate, find_spread
from abhv_mc.statistics.placement import judge_set

SETS, LEVEL = 199, 0.05
FLIGHTS, SHARES = (2, 5, 20), (0.09, 0.25, 0.49, 0.81)
_TIME = np.linspace(0.0, 40.0, 81)
_SPREADS = {"drag": 0.05, "lift": 0.05, "damping": 0.2, "inertia": 0.1, "speed": 0.01}
_NOISE = np.repeat([1.0, 0.1], _TIME.size)  # m/s, deg
_MIXTURE = np.random.default_rng(1).standard_normal((6, 5))


def draw_sets(
    draw: np.random.Generator, sets: int, flights: int, vehicles: int, share: float, case: str = ""
) -> np.ndarray:
    """Return metrics [set, flight, metric]; `share` of the variance is between vehicles."""
    of_vehicle = draw.standard_normal((sets, vehicles, 5))[:, np.arange(flights) % vehicles]
    of_flight = draw.standard_normal((sets, flights, 5))
    inputs = share**0.5 * of_vehicle + (1.0 - share) ** 0.5 * of_flight
    if case == "drag 20 % high":  # with a standard deviation of 10 %
        inputs[..., 0] += 2.0
    if case == "correlation of 0.9":
        inputs[..., 1] = 0.9 * inputs[..., 0] + 0.19**0.5 * inputs[..., 1]
    metrics = inputs @ _MIXTURE.T + 0.1 * draw.standard_normal((sets, flights, 6))
    if case == "bias of a metric":  # of one standard deviation
        metrics[..., 1] += metrics[..., 1].std() if sets > 1 else np.linalg.norm(_MIXTURE[1])
    metrics[..., 0] = np.exp(metrics[..., 0] / 2.0)
    return metrics


def study_sets(repetitions: int) -> Iterator[str]:
    """Yield the shares of honest and wrong sets that are called different."""
    wrong = ("drag 20 % high", "bias of a metric", "correlation of 0.9")
    cell = 0
    for flights in FLIGHTS:
        for vehicles in sorted({1, 2, flights}):
            for share in SHARES:
                results, cell = [], cell + 1
                for case in ("", *wrong) if share == SHARES[1] else ("",):
                    draw, p_values = np.random.default_rng(5 if case else [99, cell]), []
                    for _ in range(max(1, repetitions // 40) if case else repetitions):
                        pool = draw_sets(draw, SETS + (not case), flights, vehicles, share)
                        if case:
                            test = draw_sets(draw, 1, flights, vehicles, share, case)
                            pool = np.concatenate([pool, test])
                        result = judge_set(pool)
                        p_values.append((result.together, result.flights.min()))
                    rates = np.mean(np.array(p_values) <= LEVEL, axis=0)
                    results.append(f"{case or 'honest'} {rates[0]:.3f} (flights {rates[1]:.3f})")
                name = f"{flights} flights, {vehicles} vehicles, share {share:g}"
                yield f"{name}: {', '.join(results)}"


def glide(points: np.ndarray) -> np.ndarray:
    """Return speed and angle of attack [..., output] of coordinates [..., dispersion]."""
    factors = 1.0 + points * [*_SPREADS.values()]
    drag, lift, damping, inertia, speed = np.moveaxis(factors[..., np.newaxis], -2, 0)
    velocity = 1.0 / (1.0 / (300.0 * speed) + 0.5e-5 * drag * _TIME)
    wave = np.exp(-0.1 * damping * _TIME) * np.cos(0.8 * (lift / inertia) ** 0.5 * _TIME)
    return np.concatenate([velocity, 5.0 / lift / speed**2 * (1.0 + 0.3 * wave)], axis=-1)


def study_estimates(records: int, fleets: int) -> Iterator[str]:
    """Yield coverages of the intervals of drag and lift, and the accuracy of spreads."""
    draw = np.random.default_rng(3)
    arguments = (_NOISE, np.repeat([0, 1], _TIME.size))
    flags = {"shared": np.ones(5, bool), "listed": np.arange(5) < 2}

    def cover(truth: np.ndarray) -> str:
        data = glide(truth) + _NOISE * draw.standard_normal((len(truth), _NOISE.size))
        result = estimate(glide, data, *arguments, np.arange(len(truth)), **flags)
        inside = np.abs(result.points - truth) < 1.96 * result.errors
        drag, lift = inside.mean(axis=0)[:2]
        return f"drag {drag:.3f}, lift {lift:.3f} (p = {result.p_value:.2f})"

    truth = draw.standard_normal((records, 5)) * [3.0, 3.0, 1.0, 1.0, 1.0]
    yield f"coverage, nuisances drawn: {cover(truth)}"
    for column, name in list(enumerate(_SPREADS))[2:]:
        shifted = truth.copy()
        shifted[:, column] = 2.0
        yield f"coverage, {name} at 2 sigma: {cover(shifted)}"
    vehicles, spreads = np.arange(20), []
    for _ in range(fleets):
        truth = draw.standard_normal((20, 5)) * [3.0, 3.0, 1.0, 1.0, 1.0]
        data = glide(truth) + _NOISE * draw.standard_normal((20, _NOISE.size))
        result = estimate(glide, data, *arguments, vehicles, **flags)
        spreads.append([find_spread(result.points[:, i], result.errors[:, i])[2] for i in (0, 1)])
    near = np.abs(np.array(spreads) / 3.0 - 1.0) < 0.25
    yield f"spread within 25 %: drag {near[:, 0].mean():.3f}, lift {near[:, 1].mean():.3f}"


def study_plant(records: int) -> Iterator[str]:
    """Yield the coverage of drag, from simulated records of the S manoeuvre with noise."""
    import tempfile
    from pathlib import Path

    import pandas as pd

    from abhv_mc import Campaign, simulate

    noise = {"speed_mps": 0.5, "angle_of_attack_deg": 0.05, "equivalence_ratio": 0.005}
    laws = {
        "aero.drag": ("normal", "5 %"),
        "aero.lift": ("normal", "3 %"),
        "propulsion.thrust": ("normal", "2 %"),
        "mass.inertia_yy": ("normal", "10 %"),
        "mass.total": ("normal", "1 %"),
    }
    campaign = Campaign.make(
        {
            "name": "plant",
            "vehicle": "abhv",
            "mission": "paper_s",
            "controllers": {"tlc": "tlc"},
            "dispersions": {
                name: {"distribution": law, "sigma": sigma} for name, (law, sigma) in laws.items()
            },
            "keep": {"histories": {"rate": "2 Hz"}},
            "seed": 7,
            "runs": records,
        }
    )
    samples = campaign.draw_samples()
    flown = simulate(campaign, samples, ["tlc"], [*noise])
    draw, rows = np.random.default_rng(4), ["vehicle,history"]
    with tempfile.TemporaryDirectory() as folder:
        for k in range(records):
            columns = {"time": flown.time.to_numpy()}
            for name, sigma in noise.items():
                values = flown[name].to_numpy()[0, k]
                columns[name] = values + sigma * draw.standard_normal(values.size)
            pd.DataFrame(columns).to_csv(Path(folder, f"{k}.csv"), index=False)
            rows.append(f"V{k},{k}.csv")
        table = Path(folder, "flights.csv")
        table.write_text("\n".join(rows) + "\n", encoding="utf-8")
        answer = campaign.identify([table], ["aero.drag"], measured=noise)
    for entry in answer.parameters:
        estimates, errors = (np.array([*vars(entry)[key].values()]) for key in ("values", "errors"))
        truth = samples[entry.name].to_numpy()
        inside = np.mean(np.abs(estimates - truth) < 1.96 * errors)
        yield (
            f"plant, {records} records: coverage of {entry.name} {inside:.3f}, standard error "
            f"{errors.mean():.4f}, spread {entry.spread:.4f} (true {truth.std(ddof=1):.4f}), "
            f"{answer.simulations} simulations of each flight, p = {answer.p_value:.2f}"
        )
    for names, correlation in answer.inseparable:
        yield f"not separable: {', '.join(names)} ({correlation:.2f})"


def main() -> None:
    """Print the tables of docs/how-to/test-flights.md."""
    smoke = sys.argv[1:] == ["--smoke"]
    sizes = (2, 20, 2, 2) if smoke else (4000, 1000, 100, 200)
    for lines in (study_plant(sizes[3]), study_estimates(*sizes[1:3]), study_sets(sizes[0])):
        for line in lines:
            print(line, flush=True)


if __name__ == "__main__":
    main()
