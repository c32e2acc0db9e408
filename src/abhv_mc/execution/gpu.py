"""The campaign engine that flies on a GPU."""

from abhv_mc.campaign.file.config import THREADS
from abhv_mc.execution.engine import Engine
from abhv_mc.execution.stability import describe_stability
from abhv_mc.identity import code_hash


def make_gpu_engine() -> Engine:
    """Flights on this machine's GPU. Raises Refusal where it has none.

    Its source differs from the processor's, so that no folder mixes the two. Two threads call it: while one waits for
    its flights, the other's are counted.
    """
    from abhv_mc.jit_cuda import find_device

    device = find_device()

    from abhv_mc.flight.gpu import CAMPAIGN_BATCH, fly_on_gpu
    from abhv_mc.flight.prepare import prepare

    source = f"{code_hash()}-gpu"
    return Engine(
        prepare,
        fly_on_gpu,
        source,
        describe_stability,
        isolation=THREADS,
        device=device,
        batch=CAMPAIGN_BATCH,
        workers=2,
    )
