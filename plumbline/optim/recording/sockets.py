"""Sockets of a fixed-point recording: which there are, and which one a row rests in."""

import numpy as np
from numpy.typing import NDArray

from plumbline.optim.recording.recording import Recording


def socket_labels(recording: Recording) -> tuple[int, ...]:
    """Labels of the sockets that rows rest in, ascending."""
    assert recording.socket is not None
    return tuple(int(k) for k in np.unique(recording.socket))


def one_hot_sockets(recording: Recording) -> NDArray[np.float64]:
    """One column a socket, 1 where the row rests in it (N, s)."""
    assert recording.socket is not None
    return (recording.socket[:, None] == np.array(socket_labels(recording))).astype(float)
