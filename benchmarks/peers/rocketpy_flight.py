"""Time of RocketPy: a sounding rocket like its Calisto, in six degrees of freedom, with LSODA.

The vehicle and flight differ from those of abhv-mc, and the integrator has an adaptive step; the
time is scaled to 60 s of flight.
"""

import time

from rocketpy import Environment, Flight, Rocket, SolidMotor

SECONDS = 60.0


def make_rocket() -> Rocket:
    """Return a stable rocket of 19 kg and 127 mm diameter with nose cone and fins."""
    motor = SolidMotor(
        thrust_source=1500.0,  # N
        burn_time=3.9,
        dry_mass=1.815,
        dry_inertia=(0.125, 0.125, 0.002),
        nozzle_radius=0.033,
        grain_number=5,
        grain_density=1815.0,
        grain_outer_radius=0.033,
        grain_initial_inner_radius=0.015,
        grain_initial_height=0.12,
        grain_separation=0.005,
        grains_center_of_mass_position=0.397,
        center_of_dry_mass_position=0.317,
        nozzle_position=0.0,
        throat_radius=0.011,
        coordinate_system_orientation="nozzle_to_combustion_chamber",
    )
    rocket = Rocket(
        radius=0.0635,
        mass=14.426,
        inertia=(6.321, 6.321, 0.034),
        power_off_drag=0.45,
        power_on_drag=0.45,
        center_of_mass_without_motor=0.0,
        coordinate_system_orientation="tail_to_nose",
    )
    rocket.add_motor(motor, position=-1.255)
    rocket.add_nose(length=0.558, kind="von karman", position=1.278)
    rocket.add_trapezoidal_fins(n=4, root_chord=0.12, tip_chord=0.06, span=0.11, position=-1.049)
    return rocket


def main() -> None:
    from benchmarks.peers.peer import read_work, write_result

    work = read_work()
    environment = Environment(latitude=32.99, longitude=-106.97, elevation=1400.0)
    environment.set_atmospheric_model(type="standard_atmosphere")
    rocket = make_rocket()
    seconds = []
    for repeat in range(work.repeats + 1):
        start = time.process_time()
        flight = Flight(
            rocket=rocket,
            environment=environment,
            rail_length=5.2,
            inclination=85.0,
            heading=0.0,
            max_time=SECONDS,
        )
        took = time.process_time() - start
        if repeat:  # the first fills caches
            seconds.append(took * SECONDS / flight.t_final)
    write_result("RocketPy", seconds, flight_s=float(flight.t_final), apogee_m=float(flight.apogee))


if __name__ == "__main__":
    main()
