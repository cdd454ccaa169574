"""How noise differs from component to component, so that none is explained as a mechanism."""

from collections.abc import Callable, Sequence

import numpy as np

from plumbline.optim.core.problem import Array
from plumbline.optim.diagnosis.linearise.ports import Ports
from plumbline.optim.diagnosis.posterior.pool import Pool
from plumbline.optim.diagnosis.posterior.reduction import SelectedTerm
from plumbline.optim.diagnosis.prior import LEAST_SPREAD, NOISE_NEGLIGIBLE


def spread_of_noise(
    pool: Pool,
    chosen: Sequence[SelectedTerm],
    ports: Ports,
    unlisted: Callable[[Array], float] | None = None,
) -> Array:
    """RMS of every component of what the causes leave (m,), over that of all; ones if alike.

    Components may be noisier than others, and no mechanism is to be paid for explaining the noise
    of one axis. Unequal noise is taken only where the data ask for it (Schwarz 1978), each kind of
    noise together with what the library may lack: a joint's own encoder may err alone.

    Args:
        pool: The candidates.
        chosen: The causes.
        ports: Of these rows.
        unlisted: Log evidence of what the library may lack, under such a spread.
    """
    columns = pool.columns(chosen)
    A = ports.base[columns][:, ~ports.gross]
    t = ports.target[~ports.gross]
    flat = A.reshape(len(columns), t.size)
    z = np.linalg.lstsq(flat.T, t.ravel(), rcond=1e-10)[0]
    r = t - np.einsum("pnm,p->nm", A, z)
    if not ports.live.all():  # a component is not one thing in rows of several kinds
        return np.ones(r.shape[1])
    noise = pool.noise
    each = np.maximum(np.mean(r**2, axis=0), noise.least**2)
    ratio = each / float(each.mean())
    gain = -0.5 * len(r) * float(np.log(ratio).sum())
    price = 0.5 * (len(ratio) - 1) * np.log(max(len(r), 2)) + NOISE_NEGLIGIBLE
    alike, spread = np.ones(len(ratio)), np.sqrt(np.maximum(ratio, LEAST_SPREAD))
    if gain < price:
        return alike
    if unlisted is not None and unlisted(alike) > gain - price + unlisted(spread):
        return alike
    return np.asarray(spread)
