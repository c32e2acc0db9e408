"""Sobol indices of functions whose indices are known, from our Saltelli design."""

import numpy as np

from abhv_mc.campaign.sampling.designs import Design
from abhv_mc.plant.parameters import PARAMETERS
from abhv_mc.statistics.sobol import sobol_indices

NAMES = tuple(parameter.name for parameter in PARAMETERS[1:6])

# Ishigami & Homma 1990 with a = 7, b = 0.1, by its closed form (Saltelli et al., "Global Sensitivity Analysis", 2008).
A, B = 7.0, 0.1
VARIANCE = A**2 / 8.0 + B * np.pi**4 / 5.0 + B**2 * np.pi**8 / 18.0 + 0.5
ALONE = (0.5 * (1.0 + B * np.pi**4 / 5.0) ** 2, A**2 / 8.0, 0.0)
TOGETHER = B**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)  # of the first and the third


def flights(groups, names=NAMES[:3], seed=4):
    return Design("saltelli", seed, names, groups * (len(names) + 2)).draw(0, groups * (len(names) + 2))


def ishigami(points):
    x, y, z = (np.pi * (2.0 * column - 1.0) for column in points.T)
    return np.sin(x) + A * np.sin(y) ** 2 + B * z**4 * np.sin(x)


def test_ishigamis_indices():
    found = sobol_indices(ishigami(flights(4096))[:, None], 3)
    first = np.array(ALONE) / VARIANCE
    total = np.array([ALONE[0] + TOGETHER, ALONE[1], TOGETHER]) / VARIANCE
    np.testing.assert_allclose(found.first[:, 0], first, atol=0.02)
    np.testing.assert_allclose(found.total[:, 0], total, atol=0.02)
    for value, low, high in ((first, found.first_low, found.first_high), (total, found.total_low, found.total_high)):
        assert np.all((low[:, 0] - 1e-9 <= value) & (value <= high[:, 0] + 1e-9))


def test_idle_inputs_have_no_share_and_constant_outputs_no_indices():
    points = flights(256, NAMES)
    outputs = np.stack([points[:, 0] + 2.0 * points[:, 1], np.full(len(points), 3.0)], axis=1)
    found = sobol_indices(outputs, len(NAMES))
    np.testing.assert_allclose(found.total[:, 0], [0.2, 0.8, 0.0, 0.0, 0.0], atol=0.03)
    assert np.isnan(found.first[:, 1]).all()
