"""Linear algebra on one thread: matrices are small, and threads wait for each other.

Of two threads on two cores a diagnosis of ten thousand rows takes twice as long and four times the
processor, and sums end in other digits than of one.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module


@contextmanager
def one_thread() -> Iterator[None]:
    """As long as it lasts: whatever was set before is set again after it."""
    # SciPy has linear algebra of its own: what is not loaded yet would not be told.
    import_module("scipy.linalg")
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1, user_api="blas"):
        yield
