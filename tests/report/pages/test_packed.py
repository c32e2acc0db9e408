"""Packed arrays read back as the page's script reads them."""

import base64
import gzip

import numpy as np

from abhv_mc.report.pages.page import pack_arrays


def unpack(places, text, name):
    steps = np.frombuffer(gzip.decompress(base64.b64decode(text)), np.uint8).astype(int).reshape(2, -1)
    place = places[name]
    size = int(np.prod(place["shape"]))
    table = (steps[0] + 256 * steps[1])[place["start"] : place["start"] + size].reshape(place["shape"])
    codes = np.cumsum(table, axis=-1) % 65536
    values = place["low"] + (place["high"] - place["low"]) * codes / 65534
    return np.where(codes == 65535, np.nan, values)


def test_values_come_back_within_half_a_step_and_what_is_missing_is_missing():
    rng = np.random.default_rng(1)
    wave = np.sin(np.linspace(0.0, 20.0, 301)) * rng.uniform(0.1, 5.0, (7, 1))
    wave[3, 200:] = np.nan
    arrays = {
        "a": rng.normal(1e5, 3.0, 50),
        "wave": wave,
        "flat": np.full(4, 2.5),
        "late": np.array([np.inf, 1.0, 3.0]),
    }
    places, text = pack_arrays(arrays)
    for name, given in arrays.items():
        finite = np.where(np.isfinite(given), given, np.nan)
        step = (np.nanmax(finite) - np.nanmin(finite)) / 65534
        np.testing.assert_allclose(unpack(places, text, name), finite, rtol=1e-12, atol=0.5001 * step)
    assert pack_arrays(arrays)[1] == text
    assert len(pack_arrays({"wave": wave})[1]) < 0.6 * len(base64.b64encode(gzip.compress(wave.astype("f4").tobytes())))
