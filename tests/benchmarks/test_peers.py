from pathlib import Path

import pytest

from benchmarks.peers import run


@pytest.fixture
def measured(monkeypatch):
    """Two rounds in which the machine slows to a half, JSBSim fails, and the rest take known times."""
    rounds = iter([1.0, 2.0])
    slow = {"now": 0.0}
    tried = []

    def run_peer(python, module, work, core):
        tried.append(module)
        if module == "ours":
            slow["now"] = next(rounds)
            names = [name for name in run.ROWS if name.startswith("abhv-mc")]
            return [{"peer": n, "seconds": [2e-3 * slow["now"]] * 3, "peak_gflops": 50.0 * slow["now"]} for n in names]
        if module == "jsbsim_x15":
            raise run.PeerFailedError("no aircraft")
        name = {"twin": "C++ twin", "jax_vmap": "JAX vmap", "diffrax_steps": "diffrax", "rocketpy_flight": "RocketPy"}
        return [
            {
                "peer": name[module],
                "seconds": [5e-3 * slow["now"]] * 3,
                "altitude_difference_m": 1e-9,
                "first_call_s": 20.0,
            }
        ]

    monkeypatch.setattr(run, "run_peer", run_peer)
    monkeypatch.setattr(run, "write_work", lambda *_: None)
    return *run.measure_peers(Path("python"), 2, 3, 256), tried


def test_peers_are_compared_within_a_round(measured):
    peers, _, _ = measured
    assert peers["C++ twin"]["over_ours"] == pytest.approx(2.5, rel=1e-12)  # whatever the machine did between rounds
    assert peers["C++ twin"]["seconds_per_flight"] == pytest.approx(7.5e-3, rel=1e-12)
    assert (peers["C++ twin"]["repeats"], peers["C++ twin"]["processes"]) == (6, 2)
