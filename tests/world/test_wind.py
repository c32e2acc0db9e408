"""Wind."""

from abhv_mc.world.wind import wind_ned


def test_steady_wind_and_linear_shear() -> None:
    assert wind_ned(20000.0, 3.0, -5.0, 0.0, 0.0) == (3.0, -5.0)
    # an eastward shear must not reach the north component
    assert wind_ned(20000.0, 3.0, -5.0, 0.001, -0.002) == (23.0, -45.0)
