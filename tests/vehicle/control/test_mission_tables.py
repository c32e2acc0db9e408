"""Tables of a mission: soundings in any units and order, and tables that end within the flight."""

import re

import numpy as np
import pytest

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.check_inputs import check_inputs
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.control.mission import read_mission
from abhv_mc_vehicle.control.mission_tables import (
    DENSITIES,
    WIND,
    find_air_warnings,
    find_imbalance,
    read_air_table,
    read_ensemble,
)
from abhv_mc_vehicle.kernel.world.atmosphere import atmosphere

GAS_CONSTANT = 287.05287  # J/(kg K), US Standard Atmosphere 1976


def read(folder, text, choices=WIND, **heads):
    (folder / "air.csv").write_text(text)
    return read_air_table(folder / "air.csv", choices, heads)


@pytest.mark.parametrize(
    "text",
    [
        "altitude_m,wind_north_mps,wind_east_mps\n0,0,5\n20000,40,5\n",
        "altitude [km];wind_east [kt];wind_north (km/h)\n"
        "20;9,719222462203;144\n0;9,719222462203;0\n",
        "altitude_ft,wind_speed_mps,wind_direction_deg\n0,5,270\n"
        "65616.79790026247,40.311288741492746,187.1250163489018\n",
    ],
)
def test_wind_of_any_unit_order_and_form(tmp_path, text):
    table = read(tmp_path, text)
    assert table == pytest.approx(np.array([[0.0, 0.0, 5.0], [20e3, 40.0, 5.0]]), abs=1e-9)


def test_altitudes_with_a_comma_need_a_key(tmp_path):
    text = "altitude_m\tdensity_factor\n0\t1\n12,000\t1\n"
    with pytest.raises(InputError, match=r"12\.000 or 12000"):
        read(tmp_path, text, DENSITIES)
    for comma, height in (("decimal", 12.0), ("thousands", 12e3)):
        assert read_air_table(tmp_path / "air.csv", DENSITIES, {}, comma)[1, 0] == height


def test_a_sounding_gives_wind_and_density(tmp_path):
    text = (
        "PRES   HGHT   TEMP   DRCT   SKNT\n hPa     m      C    deg   knot\n"
        "--------------------------------\n850.0  1500    10.0    90     20\n"
        "500.0  5600   -20.0   180     40\n"
    )
    headers = {"altitude": "HGHT", "pressure": "PRES", "temperature": "TEMP"}
    table = read(tmp_path, text, DENSITIES, **headers)
    for (altitude, factor, warmth), pressure, kelvin in zip(
        table, (85e3, 50e3), (283.15, 253.15), strict=True
    ):
        expected = pressure / (GAS_CONSTANT * kelvin) / atmosphere(altitude)[0]
        assert factor == pytest.approx(expected, rel=1e-6)
        assert warmth == pytest.approx(kelvin / atmosphere(altitude)[2], rel=1e-12)
    wind = read(tmp_path, text, WIND, altitude="HGHT", wind_speed="SKNT", wind_direction="DRCT")
    knot = 1852.0 / 3600.0
    assert wind[:, 1:] == pytest.approx(knot * np.array([[0.0, -20.0], [40.0, 0.0]]), abs=1e-9)


@pytest.mark.parametrize(
    ("head", "cell", "expected"),
    [
        ("density [kg/m3],temperature [degC]", "0.1,-50", (0.1, 223.15)),
        ("temperature [degR],pressure [kPa],density [kg/m3]", "390.6,6,0.09", (0.09, 217.0)),
        ("density_factor,temperature_degF", "1,-58", (None, 223.15)),
        ("temperature_k,pressure_kpa", "217,6", (6e3 * 28.9644 / (8314.32 * 217.0), 217.0)),
        ("density [kg/m3],unknown", "0.1,-50", (0.1, None)),
    ],
)
def test_a_density_may_come_with_its_temperature(tmp_path, head, cell, expected):
    table = read(tmp_path, f"altitude [km],{head}\n18,{cell}\n20,{cell}\n", DENSITIES)
    standard, _, temperature, _ = atmosphere(20e3)
    density, kelvin = expected
    ratios = [20e3, 1.0 if density is None else density / standard]
    ratios += [] if kelvin is None else [kelvin / temperature]
    assert table[1] == pytest.approx(ratios, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "choices", "location", "fragment"),
    [
        ("altitude_m,wind_north_mps\n0,1\n9,1\n", WIND, (1, None), "wind_direction"),
        ("altitude,density_factor\n0,1\n9,1\n", DENSITIES, (1, 1), " unit"),
        ("altitude_m,density_factor\n0,1\n5,1\n5,1\n", DENSITIES, (4, 1), "that increase"),
        ("altitude_m,density_factor\n9,1\n5,1\n7,1\n", DENSITIES, (4, 1), "that decrease"),
        ("altitude_m,density_factor\n0,1\n9,-1\n", DENSITIES, (3, 3), "factor"),
        ("altitude_m,pressure_hPa,temperature\n0,1,1\n9,1,1\n", DENSITIES, (1, 25), "'K', "),
        ("altitude_m,density_factor,temperature_K\n0,1,9\n9,1,-1\n", DENSITIES, (3, 5), "-1 K"),
        (
            "altitude_m,density_factor\n" + "".join(f"{i},1\n" for i in range(10_001)),
            DENSITIES, (None, None), "10\u202f001",
        ),
    ],
)  # fmt: skip
def test_an_invalid_table_is_rejected(tmp_path, text, choices, location, fragment):
    with pytest.raises(InputError) as caught:
        read(tmp_path, text, choices)
    assert (caught.value.line, caught.value.column) == location
    assert fragment in f"{caught.value.found} {caught.value.expected}"


def test_a_table_that_ends_within_the_flight_causes_a_warning(tmp_path, repository):
    altitude = np.array([20e3, 21e3])
    table = np.array([[0.0, 5.0], [40e3, 5.0]])
    assert not find_air_warnings(tmp_path / "a.csv", table, altitude)
    for factor, units in ((1e-3, ["km"]), (0.5, []), (0.3048, []), (1e3, ["m"])):
        (warning,) = find_air_warnings(tmp_path / "a.csv", table * [factor, 1.0], altitude)
        assert re.findall(r" in (\w+)\?$", warning) == units
    assert not find_air_warnings(tmp_path / "a.csv", table * [1 / 0.3048, 1.0], altitude)
    lines = "".join(f"{i},5,5\n" for i in range(41))
    (tmp_path / "wind.csv").write_text(f"altitude_m,wind_north_mps,wind_east_mps\n{lines}")
    mission = (repository / "configs/mission/level.yaml").read_text()
    (tmp_path / "level.yaml").write_text(f"{mission}\nwind: {{file: wind.csv}}\n")
    (checked,) = check_inputs(tmp_path / "level.yaml")
    (warning,) = checked.warnings
    assert re.search(r"\b0 to 40 m\b.* in km\?$", warning)


@pytest.mark.parametrize(
    ("factor", "kelvin", "warnings"),
    [
        # an isothermal column, and the same pressure with 60 K more: -0.034 / m (1/T - 1/T')
        (lambda z: np.exp(0.0 * z), 216.65, 0),
        (lambda z: 216.65 / 276.65 + 0.0 * z, 276.65, 0),
        (lambda z: np.exp(7e-5 * (z - 15e3)), 216.65, 1),
        (lambda z: 1.0 + 0.1 * (np.abs(z - 17e3) < 600), 216.65, 0),
        (lambda z: np.exp(4e-5 * (z - 15e3)), 216.65, 0),
    ],
)
def test_air_that_is_not_in_balance_causes_a_warning(factor, kelvin, warnings):
    z = np.arange(12e3, 19.5e3, 500.0)
    columns = [z, 0.0 * z, 0.0 * z, factor(z), np.full(len(z), kelvin / 216.65)]
    assert len(find_imbalance(np.stack(columns, axis=1))) == warnings


HEAD = "member,altitude_km,wind_north_mps,wind_east_mps,density_factor,weight\n"
PAIR = "a,0,1,2,1,3\na,30,1,2,1,3\nb,20,3,4,1.1,1\nb,10,5,6,1.2,1\n"


def test_members_and_weights_are_read_in_the_order_of_the_file(tmp_path):
    (tmp_path / "air.csv").write_text(HEAD + PAIR)
    members, weights = read_ensemble(tmp_path / "air.csv", {})
    assert weights.tolist() == [3.0, 1.0]
    assert members[0].tolist() == [[0.0, 1.0, 2.0, 1.0, 1.0], [30e3, 1.0, 2.0, 1.0, 1.0]]
    assert members[1].tolist() == [[10e3, 5.0, 6.0, 1.2, 1.0], [20e3, 3.0, 4.0, 1.1, 1.0]]


@pytest.mark.parametrize(
    ("text", "line", "fragment"),
    [
        (HEAD + PAIR.replace("3\nb", "2\nb"), 2, "'a' has the weights 2 to 3"),
        (HEAD + PAIR[: PAIR.index("b")], 1, "found 1 member"),
        (HEAD + PAIR.replace("b,10", "b,20"), 5, "out of order"),
        (HEAD + PAIR.replace("1.2", "-1"), 5, "density"),
        (HEAD.replace("member", "number") + PAIR, 1, "no column 'member'"),
        ("member,altitude_m\na,0\na,1\nb,0\nb,1\n", 1, "required columns"),
    ],
)
def test_an_invalid_ensemble_is_rejected(tmp_path, text, line, fragment):
    (tmp_path / "air.csv").write_text(text)
    with pytest.raises(InputError, match=fragment) as caught:
        read_ensemble(tmp_path / "air.csv", {})
    assert caught.value.line == line


def test_campaigns_draw_the_members_by_their_weights(tmp_path, repository):
    (tmp_path / "air.csv").write_text(HEAD + PAIR)
    mission = (repository / "configs/mission/level.yaml").read_text()
    (tmp_path / "level.yaml").write_text(f"{mission}\natmosphere: {{ensemble: air.csv}}\n")
    campaign = (
        "name: a\nvehicle: ghame_x\nmission: level.yaml\ncontrollers: {tlc: tlc}\nruns: 400\n"
    )
    (tmp_path / "campaign.yaml").write_text(campaign)
    experiment = read_campaign(tmp_path / "campaign.yaml")
    drawn = experiment.make_samples().draw(0, 400)
    assert experiment.inputs == ("atmosphere.member",) and set(drawn[:, 0]) == {1.0, 2.0}
    assert np.mean(drawn == 1.0) == pytest.approx(0.75, abs=0.06)
    (tmp_path / "campaign.yaml").write_text(
        campaign + "dispersions: {atmosphere.member: {distribution: discrete, values: [0, 2]}}\n"
    )
    kept = read_campaign(tmp_path / "campaign.yaml").make_samples().draw(0, 40)
    assert set(kept[:, 0]) == {0.0, 2.0}
    above = PAIR.replace("b,20", "b,50").replace("b,10", "b,40")
    (tmp_path / "air.csv").write_text(HEAD + above)
    with pytest.raises(InputError, match="altitudes that overlap"):
        read_mission(tmp_path / "level.yaml")
