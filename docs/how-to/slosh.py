"""Lateral slosh as a mass on a spring ahead of the centre of gravity."""

from abhv_mc.extend import Effect, dynamics


@dynamics
def slosh(states, motion, air, controls, settings):
    """Return the rates of the mass, and its force and moment on the vehicle."""
    felt = motion.acceleration_y - motion.gravity_y + settings.arm * motion.yaw_acceleration
    spring = 2.0 * settings.damping * settings.frequency * states.rate
    spring += settings.frequency * settings.frequency * states.offset
    share = settings.mass * (1.0 / motion.mass + settings.arm * settings.arm / settings.inertia)
    acceleration = -(felt + spring) / (1.0 - share)
    force = -settings.mass * acceleration
    displaced = settings.mass * states.offset
    roll = -displaced * (motion.acceleration_z - motion.gravity_z)
    yaw = settings.arm * force + displaced * (motion.acceleration_x - motion.gravity_x)
    return Effect(
        rates=(states.rate, acceleration), force=(0.0, force, 0.0), moment=(roll, 0.0, yaw)
    )
