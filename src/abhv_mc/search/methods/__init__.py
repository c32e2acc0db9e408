"""Search algorithms: worst case in a box, rare-event probability, optimal parameters.

Every algorithm uses arrays only. It calls a given function with batches of points [point,
dimension] that fill the lanes of compiled flights, and receives one value (or one row) for each
point. Random numbers depend on the seed and the step only, so that equal values lead to equal
points: a search is resumed by answering its first batches from stored flights.
"""
