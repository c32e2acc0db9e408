"""Comparison of coefficients and mass of public models with JSBSim."""

import runpy
from types import SimpleNamespace

import numpy as np
import pytest
from jsbsim_models.peer import FOOT, SLUG, deflect, load, model

from abhv_mc.io.documents import read_document
from abhv_mc.io.units import parse_any
from abhv_mc_jsbsim.import_vehicle import import_jsbsim

POINTS = 300
PSF = 4.4482216152605 / FOOT**2


@pytest.mark.parametrize("name", ["X15", "f16", "Shuttle", "x24b"])
def test_coefficients_and_mass_are_those_of_jsbsim(name, tmp_path):
    imported = import_jsbsim(model(name), tmp_path)
    vehicle = read_document(tmp_path / "vehicle.yaml").data
    function = runpy.run_path(str(tmp_path / "aerodynamics.py"))["coefficients"]
    point = {key: parse_any(text) for key, text in vehicle["mass"]["points"][0].items()}
    to_reference = -np.array([point["center_of_gravity_x"], 0.0, point["center_of_gravity_z"]])
    keys = dict(zip(imported.settings, vehicle["aerodynamics"].get("settings", ()), strict=True))
    peer, random = load(name), np.random.default_rng(36)
    for _ in range(POINTS):
        settings = {key: random.uniform() for key in keys.values()}
        for property_name, key in keys.items():
            peer[property_name] = settings[key]
        deflections = np.radians(random.uniform(-20.0, 20.0, 3))
        deflect(peer, *deflections)
        peer["ic/h-sl-ft"], peer["ic/vt-fps"] = random.uniform(5e3, 6e4), random.uniform(300, 3000)
        peer["ic/alpha-deg"], peer["ic/beta-deg"] = random.uniform(-8, 20), random.uniform(-10, 10)
        for letter in "pqr":
            peer[f"ic/{letter}-rad_sec"] = random.uniform(-0.5, 0.5)
        peer.run_ic()
        peer.run_ic()  # the drag is computed from the lift of the previous run
        pressure, area = peer["aero/qbar-psf"], peer["metrics/Sw-sqft"]
        speed, span, chord = (
            peer[name] for name in ("velocities/vt-fps", "metrics/bw-ft", "metrics/cbarw-ft")
        )
        air = SimpleNamespace(
            altitude=peer["position/h-sl-ft"] * FOOT,
            mach=peer["velocities/mach"],
            dynamic_pressure=pressure * PSF,
            airspeed=speed * FOOT,
            angle_of_attack=peer["aero/alpha-rad"],
            sideslip=peer["aero/beta-rad"],
        )
        lengths = {"roll": ("p", span), "pitch": ("q", chord), "yaw": ("r", span)}
        rates = SimpleNamespace(
            **{
                f"{axis}_rate": peer[f"velocities/{letter}-aero-rad_sec"] * length / (2.0 * speed)
                for axis, (letter, length) in lengths.items()
            }
        )
        controls = SimpleNamespace(
            **dict(zip(("aileron", "rudder", "elevator"), deflections, strict=True))
        )
        ours = function(air, controls, rates, SimpleNamespace(**settings))
        forces = np.array([peer[f"forces/fw{axis}-aero-lbs"] for axis in "xyz"])
        assert np.array([ours.CD, ours.CC, ours.CL]) == pytest.approx(
            forces / (pressure * area), abs=1e-9
        )
        body = np.array([peer[f"forces/fb{axis}-aero-lbs"] for axis in "xyz"])
        about_center = np.array([peer[f"moments/{axis}-aero-lbsft"] for axis in "lmn"])
        about_reference = about_center - np.cross(to_reference / FOOT, body)
        scale = pressure * area * np.array([span, chord, span])
        assert np.array([ours.Cl, ours.Cm, ours.Cn]) == pytest.approx(
            about_reference / scale, abs=1e-9
        )
    assert point["mass"] == pytest.approx(peer["inertia/mass-slugs"] * SLUG, rel=2e-8)
    for key, property_name in (
        ("inertia_xx", "ixx"),
        ("inertia_yy", "iyy"),
        ("inertia_zz", "izz"),
        ("inertia_matrix_element_13", "ixz"),
    ):
        theirs = peer[f"inertia/{property_name}-slugs_ft2"] * SLUG * FOOT**2
        assert point[key] == pytest.approx(theirs, rel=2e-8)
