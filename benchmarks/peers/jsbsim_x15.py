"""Time of JSBSim: 60 s of gliding flight of its X-15 from 24 km and 1400 m/s, at 100 Hz.

The vehicle, its flight control system, tables and ground model differ from those of abhv-mc; one
flight is run at a time.
"""

import math
import time

import jsbsim

from benchmarks.peers.peer import read_work, write_result

STEP = 0.01  # s
SECONDS = 60.0
FOOT = 0.3048  # m


def start() -> jsbsim.FGFDMExec:
    """Return the aircraft at its start; loading its files is not part of the flight."""
    simulation = jsbsim.FGFDMExec(None)
    simulation.set_debug_level(0)
    simulation.load_model("X15")
    simulation.set_dt(STEP)
    simulation["ic/h-sl-ft"] = 24e3 / FOOT
    simulation["ic/vt-fps"] = 1400.0 / FOOT
    simulation["ic/gamma-deg"] = 10.0
    simulation["ic/alpha-deg"] = 4.0
    simulation.run_ic()
    return simulation


def main() -> None:
    work = read_work()
    seconds = []
    for _ in range(work.repeats):
        simulation = start()
        begin = time.process_time()
        for _ in range(round(SECONDS / STEP)):
            simulation.run()
        seconds.append(time.process_time() - begin)
    altitude = simulation["position/h-sl-ft"] * FOOT
    if not (math.isfinite(altitude) and altitude > 0.0):
        raise RuntimeError(f"the X-15 ended at {altitude} m")
    write_result("JSBSim", seconds, end_altitude_m=altitude)


if __name__ == "__main__":
    main()
