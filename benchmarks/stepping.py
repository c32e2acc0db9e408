"""Flight-steps of Plant per second and core, with and without measurements, beside JSBSim.

A flight-step is 10 control ticks of 10 ms of one flight. gym-jsbsim (PyPI, 2020) needs packages
that current versions of Python no longer support; its step is repeated here with JSBSim itself: set
four commands, run 10 integration steps of 10 ms, and read 12 properties.
"""

import sys
import time

import abhv_mc

FLIGHTS, STEPS, TICKS = 1024, 30, 10
if sys.argv[1:] == ["--smoke"]:
    FLIGHTS, STEPS = 32, 2
DISPERSIONS = {"aero.lift": {"distribution": "uniform", "half_width": "10 %"}}
READ = (
    *("position/h-sl-ft", "velocities/vt-fps", "flight-path/gamma-rad", "attitude/psi-rad"),
    *("aero/alpha-rad", "aero/beta-rad", "attitude/phi-rad", "attitude/theta-rad"),
    *("velocities/p-rad_sec", "velocities/q-rad_sec", "velocities/r-rad_sec", "velocities/mach"),
)


def measure_plant(observe: bool) -> float:
    """Return the flight-steps per second of processor time."""
    plant = abhv_mc.Plant("level", flights=FLIGHTS, dispersions=DISPERSIONS, channels=())
    plant.step(plant.nominal, TICKS, observe)
    begin = time.process_time()
    for _ in range(STEPS):
        plant.step(plant.nominal, TICKS, observe)
    return FLIGHTS * STEPS / (time.process_time() - begin)


def measure_jsbsim() -> float:
    """Return the steps per second of processor time of one flight of the X-15."""
    from benchmarks.peers.jsbsim_x15 import start

    simulation = start()
    begin = time.process_time()
    for _ in range(10 * STEPS):
        for axis in ("aileron", "rudder", "elevator", "throttle"):
            simulation[f"fcs/{axis}-cmd-norm"] = 0.0
        for _ in range(TICKS):
            simulation.run()
        for name in READ:
            simulation[name]
    return 10 * STEPS / (time.process_time() - begin)


print(f"{FLIGHTS} flights, {TICKS} ticks of 10 ms in a step; flight-steps per second and core:")
print(f"Plant, with measurements     {measure_plant(True):10,.0f}")
print(f"Plant, without measurements  {measure_plant(False):10,.0f}")
print(f"JSBSim, as in gym-jsbsim     {measure_jsbsim():10,.0f}")
