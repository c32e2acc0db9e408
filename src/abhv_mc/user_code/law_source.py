"""The code that a controller file names, read as it is and not run."""

from pathlib import Path

from abhv_mc.control.law_file import CController, FmuController, UserController, find_files
from abhv_mc.user_code.c_source import read_c_source, with_library
from abhv_mc.user_code.fmu_source import read_fmu_source
from abhv_mc.user_code.source import UserSource, read_source
from abhv_mc.user_code.trust import check_trusted, is_in_a_folder


def law_place(controller: UserController) -> Path:
    """The file that is the law, beside which its other files lie."""
    if isinstance(controller, CController):
        return controller.library or controller.sources[0]
    return controller.file


def read_law_source(controller: UserController) -> UserSource:
    """A controller's code with the files that it declares. Raises InputError."""
    if isinstance(controller, CController):
        return read_c_source(controller)
    if isinstance(controller, FmuController):
        return read_fmu_source(controller)
    return read_source(law_place(controller), find_files(controller))


def read_trusted_law(controller: UserController) -> UserSource:
    """A controller's code that is to be run. Raises InputError for a folder's copy that its user has not flown."""
    source = read_law_source(controller)
    if is_in_a_folder(law_place(controller)):
        check_trusted(source)
    return with_library(source)
