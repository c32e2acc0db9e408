"""Numbers of controllers: gains for other programs read back to the bit; tuned ones written anywhere."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest
from scipy.io import loadmat

from abhv_mc.campaign.file.tuning import Free
from abhv_mc.control.controller_file import read_controller
from abhv_mc.io.documents import read_document
from abhv_mc.io.input_error import InputError
from abhv_mc.kernel.laws.columns import LQR_GAINS
from abhv_mc.one_flight.given import make_flight_plan
from abhv_mc.simulators.candidates import read_controller_numbers
from abhv_mc.simulators.export_gains import write_gains


@pytest.fixture(scope="module")
def plan():
    return make_flight_plan("level", "ghame_x", "lqr")


def test_mat_and_csv_hold_the_plans_gains(plan, tmp_path):
    for ending in (".mat", ".csv"):
        write_gains(tmp_path / f"gains{ending}", plan)
    held = loadmat(tmp_path / "gains.mat")
    assert np.array_equal(held["gains"], plan.gains)
    assert [name.item() for name in held["names"].ravel()] == list(LQR_GAINS)
    table = np.genfromtxt(tmp_path / "gains.csv", delimiter=",", names=True)
    assert table.dtype.names == ("time_s", *LQR_GAINS)
    assert np.array_equal(table["elevator_by_pitch_rate"], plan.gains[:, LQR_GAINS.index("elevator_by_pitch_rate")])
    with pytest.raises(InputError, match=r"\.txt"):
        write_gains(tmp_path / "gains.txt", plan)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_c_arrays_hold_the_plans_gains(plan, tmp_path):
    write_gains(tmp_path / "gains.h", plan)
    text = '#include "gains.h"\ndouble at(int tick) { return gain[tick][GAIN_RUDDER_BY_BANK]; }\n'
    (tmp_path / "at.c").write_text(text + "double last(void) { return gain_time_s[GAIN_TICKS - 1]; }\n")
    subprocess.run(["cc", "-shared", "-fPIC", "-o", "at.so", "at.c"], cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "at.so"))
    library.at.restype = library.last.restype = ctypes.c_double
    assert library.at(17) == plan.gains[17, LQR_GAINS.index("rudder_by_bank")]
    assert library.last() == plan.timing.duration


LAW = "law: python\nfile: ../laws/mine.py\nrate: 100 Hz\nsettings: {path: 0.5 1/s}\n"


def test_a_law_of_ones_own_stays_the_same_file_wherever_the_numbers_are_written(tmp_path):
    """`tune` looked for it beside the new file: it found none, or one of the same name there."""
    for name in ("study/laws", "study/control", "out", "laws"):
        (tmp_path / name).mkdir(parents=True, exist_ok=True)
    for name in ("study/laws/mine.py", "laws/mine.py"):
        (tmp_path / name).write_text("", encoding="utf-8")
    controller = tmp_path / "study/control/mine.yaml"
    controller.write_text(LAW, encoding="utf-8")
    numbers = read_controller_numbers(controller, [Free(key="settings.path")], read_document(controller), ())
    written = tmp_path / "out/new.yaml"
    numbers.write(written, np.ones(1))
    law = read_controller(written)
    assert law.file == tmp_path / "out/../study/laws/mine.py" and law.file.samefile(tmp_path / "study/laws/mine.py")
    assert law.settings == {"path": "2.5 1/s"}
