"""Warnings about valid vehicle files."""

import pytest

from abhv_mc.plant.vehicles import load_vehicle
from abhv_mc.vehicle.warnings import find_vehicle_warnings


@pytest.fixture
def without_empty_mass(repository, tmp_path):
    for folder in ("ghame", "winged_cone"):
        (tmp_path / folder).symlink_to(repository / "configs/vehicle" / folder)
    text = (repository / "configs/vehicle/ghame_x.yaml").read_text()
    lines = [line for line in text.splitlines() if not line.strip().startswith("empty:")]
    assert len(lines) == len(text.splitlines()) - 1
    file = tmp_path / "vehicle.yaml"
    file.write_text("\n".join(lines))
    return file


def test_shipped_vehicle_has_none(repository):
    assert find_vehicle_warnings(load_vehicle(repository / "configs/vehicle/ghame_x.yaml")) == []


def test_missing_empty_mass_is_said(without_empty_mass):
    (warning,) = find_vehicle_warnings(load_vehicle(without_empty_mass))
    assert "no mass.empty" in warning
    assert "burns no fuel" in warning
