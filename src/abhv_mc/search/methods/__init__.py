"""Search algorithms: worst case in a box, rare-event probability, optimal parameters.

Every algorithm works on arrays only: it passes batches of points [point, dimension] to a function
that returns one value (or row) per point. Batch sizes are multiples of the number of flights that
compiled code simulates in parallel. Random numbers depend only on the seed and the step, so a
repeated search requests the same points: a search is resumed by reading the values of its first
batches from stored flights.
"""
