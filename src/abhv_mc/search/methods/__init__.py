"""Search algorithms: worst case in a box, rare-event probability, optimal parameters.

Every algorithm uses arrays only. It calls a given function with batches of points [point,
dimension] that fill the lanes of compiled flights, and receives one value (or one row) for each
point. Its random numbers depend on its seed and on the step, so that equal values give equal
points: a search is resumed by answering its first batches from stored flights.
"""
