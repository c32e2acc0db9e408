"""Flights of projectiles without thrust, all rows in one call."""

import numpy as np

from abhv_mc.interfaces import FlightBlock, Simulator


class Ballistic(Simulator):
    """Simulator of the metrics range and apex."""

    def make_plans(self, names):
        """Return the inputs, metrics and settings of each system."""
        return {name: self.plan_of(name) for name in names}

    @staticmethod
    def fly(plan, rows, recorded=None):
        """Compute the flights of ``rows`` [flight, input]; outcome 0 is a complete flight."""
        speed, angle, drag = (
            rows[:, plan.inputs.index(name)] for name in ("speed", "angle", "drag")
        )
        forward, up = speed * np.cos(np.radians(angle)), speed * np.sin(np.radians(angle))
        time = 2.0 * up / 9.81
        values = {"range": forward * time * (1.0 - drag), "apex": up**2 / 19.62}
        metrics = np.column_stack([values[metric.name] for metric in plan.metrics])
        return FlightBlock(np.zeros(len(rows), np.int64), time, metrics)
