"""Messages about kernels, in commands that read no campaign."""

from abhv_mc.cli import printing
from abhv_mc.compiling import tell


def announce_compiling() -> None:
    """Enable messages on standard error about kernels that are being compiled."""
    printing.announce_compiling()
    from abhv_mc_vehicle.kernel.jit import set_compile_listener

    set_compile_listener(tell)
