"""What a vehicle of functions costs: processor time of ``ghame_x`` written both ways, in turns (TLC at most 3)."""

import statistics
import sys
import tempfile
import time
from pathlib import Path

from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.prepare import prepare

ROOT = Path(__file__).parents[1]
FLIGHTS, ROUNDS = 64, int(sys.argv[1]) if len(sys.argv) > 1 else 9

sys.path.insert(0, str(ROOT / "tests"))
from user_code.test_vehicle_functions import write_ghame_x  # noqa: E402  of the tests, which are no package

configs = ROOT / "configs"
vehicles = {"tables": configs / "vehicle" / "ghame_x.yaml", "functions": write_ghame_x(Path(tempfile.mkdtemp()))}
parameters = nominal_parameters(FLIGHTS)
for law in ("tlc", "lqr"):
    controller = configs / "control" / f"{law}.yaml"
    plans = {
        name: prepare(vehicle, configs / "mission" / "s_manoeuvre.yaml", controller, law)
        for name, vehicle in vehicles.items()
    }
    seconds: dict[str, list[float]] = {name: [] for name in plans}
    for plan in plans.values():
        fly(plan, parameters[:1])
    for _ in range(ROUNDS):
        for name, plan in plans.items():
            start = time.process_time()
            fly(plan, parameters)
            seconds[name].append(time.process_time() - start)
    ratio = statistics.median(a / b for a, b in zip(seconds["functions"], seconds["tables"], strict=True))
    least = {name: 1e3 * min(taken) / FLIGHTS for name, taken in seconds.items()}
    words = f"{least['tables']:.2f} ms a flight of tables, {least['functions']:.2f} of functions"
    print(f"{law}: {words}, {ratio:.2f} x (median)")
