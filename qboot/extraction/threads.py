"""One thread for linear algebra: sums that are split among threads are rounded differently, in the last bits."""

import contextlib
from collections.abc import Iterator


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """While in this context (or decorated by it), BLAS and OpenMP use one thread, whatever the environment says.

    Results then do not depend on how many cores a machine has, nor on how many others a program may use.
    """
    # What brings thread pools must be loaded before they are limited; it takes a second: only those who need it pay.
    import sklearn.cluster
    import sklearn.linear_model  # noqa: F401
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1):
        yield
