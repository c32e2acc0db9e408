"""Three bending modes in pitch.

Angle of attack, elevator and engine excite them; gyro and vane measure them.

Structure after Bolender and Doman, A Non-Linear Model for the Longitudinal Dynamics of a Hypersonic
Air-breathing Vehicle (2005), ADA445058: each mode is an oscillator with a generalized force that is
linear in angle of attack, deflection and thrust; the shape tilts the nose, which turns the flow at
the inlet and at the sensors. The numbers of participation are this file's own.
"""

from abhv_mc.extend import Effect, Sensed, dynamics


@dynamics
def bending(states, motion, air, controls, settings):
    """Rates of the modes' nose displacements (m) and their effects.

    They add to the forces on the vehicle and to the measurements of its sensors.
    """
    pressure = air.dynamic_pressure * settings.area  # N
    load = pressure / motion.mass  # m/s2
    alpha, elevator, eta = air.angle_of_attack, controls.elevator, controls.equivalence_ratio
    push = alpha + settings.elevator * elevator + settings.engine * eta

    acceleration_1 = (
        settings.excitation_1 * load * push
        - 2.0 * settings.damping_1 * settings.frequency_1 * states.mode_1_rate
        - settings.frequency_1 * settings.frequency_1 * states.mode_1
    )
    acceleration_2 = (
        settings.excitation_2 * load * push
        - 2.0 * settings.damping_2 * settings.frequency_2 * states.mode_2_rate
        - settings.frequency_2 * settings.frequency_2 * states.mode_2
    )
    acceleration_3 = (
        settings.excitation_3 * load * push
        - 2.0 * settings.damping_3 * settings.frequency_3 * states.mode_3_rate
        - settings.frequency_3 * settings.frequency_3 * states.mode_3
    )
    # The nose is tilted by the shapes: their slopes there and at the gyro have alternating signs
    # along the body.
    tilt = settings.nose_slope * (states.mode_1 + states.mode_2 + states.mode_3)
    gyro = settings.gyro_slope * (states.mode_1_rate - states.mode_2_rate + states.mode_3_rate)
    return Effect(
        rates=(
            states.mode_1_rate,
            acceleration_1,
            states.mode_2_rate,
            acceleration_2,
            states.mode_3_rate,
            acceleration_3,
        ),
        force=(0.0, 0.0, -settings.lift * pressure * tilt),
        moment=(0.0, settings.moment * pressure * settings.chord * tilt, 0.0),
        sensed=Sensed(pitch_rate=gyro, angle_of_attack=tilt),
    )
