"""Beyond sampling: the worst case in a box, the probability of a rare event, better values of free parameters.

Every algorithm here sees arrays alone. It is given a function that takes points ``[point, dimension]`` and returns one
value (or one row) for each, and it calls that function with batches that fill the lanes of compiled flights. Its
random numbers belong to its seed and its place in the algorithm, so the same values give the same points again: a
search is resumed by answering its first batches from what was stored.
"""
