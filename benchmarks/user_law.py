"""Processor time of custom laws (Python, C, FMU) and metrics relative to the built-in LQR."""

import dataclasses
import statistics
import sys
import tempfile
import time
from pathlib import Path

from abhv_mc.custom_code.child import allow_here
from abhv_mc.flights.metrics import pack_metrics
from abhv_mc.io.documents import Document
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.flight.prepare import prepare
from abhv_mc_vehicle.vehicle_simulator.user_metrics import MetricEntry, declare_metrics

ROOT = Path(__file__).parents[1]
FLIGHTS, ROUNDS = 128, 9
if sys.argv[1:] == ["--smoke"]:
    FLIGHTS, ROUNDS = 2, 1
elif sys.argv[1:]:
    ROUNDS = int(sys.argv[1])
METRICS = {
    f"m{i}": {"of": source, "statistic": statistic}
    for i, (source, statistic) in enumerate(
        [
            ("bank_error_deg", "peak_to_peak"), ("altitude_error_m", "mean"), ("mach", "max"),
            ("thrust_n", "integral"), ("elevator_deg", "travel"), ("speed_error_mps", "rms"),
            ("load_factor_g", "max"), ("bank_deg", "min"),
            ("sideslip_deg", "max_abs"), ("pitch_rate_dps", "final"),
        ]
    )
}  # fmt: skip

sys.path.insert(0, str(ROOT / "tests"))
from fmu.make_fmu import make_fmu, write_controller  # noqa: E402  not an installed package

allow_here()  # native code runs in this process, which it may crash
configs = ROOT / "configs"
files = configs / "vehicle" / "ghame_x.yaml", configs / "mission" / "s_manoeuvre.yaml"
built_in = prepare(*files, configs / "control" / "lqr.yaml", "lqr")
entries = {name: MetricEntry(**entry) for name, entry in METRICS.items()}
declared = pack_metrics(declare_metrics(entries, (), Document("-", {}, {(): (1, 1)}, {}), (), []))
plans = {
    "built-in LQR": built_in,
    "cascade in Python": prepare(*files, configs / "control" / "cascade.yaml", "own"),
    "with ten metrics": dataclasses.replace(built_in, declared=declared),
    "inversion, on board": prepare(*files, configs / "control" / "inversion.yaml", "own"),
}
plans["LQR in C"] = prepare(*files, configs / "control" / "lqr_c" / "lqr_c.yaml", "own")
for version in (2, 3):
    folder = Path(tempfile.mkdtemp())
    make_fmu(folder / "lqr.fmu", version, ROOT)
    write_controller(folder / "lqr.yaml", "lqr.fmu", ROOT)
    plans[f"LQR as FMI {version}"] = prepare(*files, folder / "lqr.yaml", "own")
parameters = nominal_parameters(FLIGHTS)
seconds: dict[str, list[float]] = {name: [] for name in plans}
for plan in plans.values():
    fly(plan, parameters[:1])
for _ in range(ROUNDS):
    for name, plan in plans.items():
        start = time.process_time()
        fly(plan, parameters)
        seconds[name].append(time.process_time() - start)
ticks = FLIGHTS * (built_in.timing.ticks + 1)
for name, taken in seconds.items():
    ratio = statistics.median(a / b for a, b in zip(taken, seconds["built-in LQR"], strict=True))
    print(
        f"{name:20} {1e9 * min(taken) / ticks:7.1f} ns a flight and tick at best, {ratio:.3f} x "
        "built-in (median)"
    )
