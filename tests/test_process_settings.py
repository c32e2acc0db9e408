"""Limit of the threads of BLAS with overlapping calls."""

from threadpoolctl import threadpool_info, threadpool_limits

from abhv_mc.process_settings import one_blas_thread


def count_threads():
    return {
        library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"
    }


def test_the_limit_ends_with_the_last_that_needs_it(monkeypatch):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    with threadpool_limits(2, "blas"):
        first, second = one_blas_thread(), one_blas_thread()
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert count_threads() == {1}
        second.__exit__(None, None, None)
        assert count_threads() == {2}
