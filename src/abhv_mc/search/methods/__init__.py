"""Search algorithms: worst case in a box, rare-event probability, optimal parameters.

Every algorithm uses arrays only. It calls a given function with batches of points [point,
dimension], sized to fill the lanes of compiled flights, and receives one value (or row) per point.
Random numbers depend only on the seed and the step, so that the same values lead to the same
points: a search is resumed by answering its first batches from stored flights.
"""
