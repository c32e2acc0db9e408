"""Vertical flight of a sounding rocket that shall reach exactly 3000 m.

Air brakes remove the excess energy.
"""

from math import exp, log

GRAVITY, TARGET, STEP = 9.81, 3000.0, 0.02  # m/s2, m, s
THRUST, BURN = 2100.0, 3.6  # N, s
BODY, BRAKES = 0.0082, 0.006  # m2, drag areas of the body and of the open brakes


def fly(inputs, settings):
    """Simulate one flight.

    `inputs` and the result are by name, in the units of campaign.yaml; `settings` are a
    system's.
    """
    mass = inputs["mass"]
    time = height = speed = load = 0.0
    while time < BURN or speed > 0.0:
        density = 1.225 * exp(-height / 9000.0)
        thrust, area = 0.0, BODY * inputs["drag"]
        if time < BURN:
            thrust = THRUST * inputs["thrust"]
        elif brakes_open(time, height * inputs["altimeter"], speed, mass, settings):
            area += BRAKES
        force = thrust - 0.5 * density * speed * speed * area
        speed += (force / mass - GRAVITY) * STEP
        height += speed * STEP
        time += STEP
        load = max(load, abs(force / mass) / GRAVITY)
    return {
        "apogee": height,
        "apogee_miss": abs(height - TARGET),
        "load_max": load,
        "end_time": time,
    }


def brakes_open(time, height, speed, mass, settings):
    """Return whether to open the air brakes.

    The controller under test opens them by the clock, or if the rocket would fly too high
    otherwise.
    """
    if settings["brakes"] == "timed":
        return settings["from"] <= time < settings["to"]
    k = 0.5 * 1.225 * exp(-height / 9000.0) * BODY / mass
    return height + log(1.0 + k * speed * speed / GRAVITY) / (2.0 * k) > TARGET
