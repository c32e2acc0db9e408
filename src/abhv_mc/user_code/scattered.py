"""Look-ups on scattered points: linear in the simplices of their Delaunay triangulation."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from abhv_mc.io.input_error import Refusal
from abhv_mc.kernel.jit import scalar
from abhv_mc.user_code.table import LookUp

_INSIDE = -1e-12  # of a barycentric coordinate: rounding on a face


class Scattered(LookUp):
    """Values at points: ``scattered(points, values)`` with points [point, axis] and values [point].

    Outside of the points' hull the simplex that lies nearest holds: its coordinates below zero become zero.
    """

    def __init__(self, points: ArrayLike, values: ArrayLike) -> None:
        from scipy.spatial import Delaunay, QhullError

        at, held = (np.ascontiguousarray(array, dtype=np.float64) for array in (points, values))
        at = at[:, np.newaxis] if at.ndim == 1 else at
        if at.ndim != 2 or held.shape != at.shape[:1] or not (np.isfinite(at).all() and np.isfinite(held).all()):
            raise Refusal(
                f"points of the shape {at.shape} and values {held.shape}", "points[point, axis], values[point]"
            )
        if at.shape[1] == 1:
            order = np.argsort(at[:, 0])
            corners = np.stack([order[:-1], order[1:]], axis=1)
        else:
            try:
                corners = Delaunay(at).simplices
            except QhullError:
                raise Refusal("points that span no volume", "points that do not lie in a plane") from None
        self.axes = at.shape[1]
        self.values = held[corners]  # [simplex, corner]
        # Barycentric coordinates: transform [simplex, axis, axis] times the distance from the last corner.
        last = at[corners[:, -1]]
        edges = np.swapaxes(at[corners[:, :-1]] - last[:, np.newaxis], 1, 2)
        self.transform, self.last = np.linalg.inv(edges), np.ascontiguousarray(last)

    def make_compiled(self) -> Any:
        axes, simplices = self.axes, len(self.values)
        transform, last, values = self.transform, self.last, self.values

        def look_up(*at):  # type: ignore[no-untyped-def]
            best, worst = 0, -np.inf
            for k in range(simplices):  # the one whose least coordinate is greatest holds the point, or is nearest
                least, rest = np.inf, 1.0
                for i in range(axes):
                    part = 0.0
                    for j in range(axes):
                        part += transform[k, i, j] * (at[j] - last[k, j])
                    least = part if part < least else least
                    rest -= part
                least = rest if rest < least else least
                better = least > worst and worst < _INSIDE
                best = k if better else best
                worst = least if better else worst
            total, sum_of, rest = 0.0, 0.0, 1.0
            for i in range(axes):
                part = 0.0
                for j in range(axes):
                    part += transform[best, i, j] * (at[j] - last[best, j])
                rest -= part
                held = part if part > 0.0 else 0.0
                total += held * values[best, i]
                sum_of += held
            held = rest if rest > 0.0 else 0.0
            return (total + held * values[best, axes]) / (sum_of + held)

        return scalar(look_up)
