"""What a recording cannot tell from the truth.

For every other effect and element, the truth's displacement D is fitted by that rival's k columns B
together with the columns A of what is always fitted. With n readings and k* columns for the truth,

    separation = |D - [A B] [A B]^+ D|^2 / sigma^2 + max(k - k*, 0) log n

is what the best judge could gain from all readings in favour of the truth: twice the log-likelihood
ratio, and the price of a rival that is richer than the truth (Schwarz, 1978). Below `ENOUGH` nobody
can be blamed for naming the rival: the truth file lists it as confounded.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from plumbline.experiments.reality import body_effects as body
from plumbline.experiments.reality import end_effects as end
from plumbline.experiments.reality import gap
from plumbline.experiments.reality import joint_effects as joint
from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.draws import offered
from plumbline.experiments.reality.recorder import Case
from plumbline.experiments.reality.scene import Mechanism, Scene

ENOUGH = 9.0  # twice the log likelihood ratio below which nobody can be blamed: three sigma
QUARTER = np.pi / 2.0
SINGLE = (
    joint.JointOffset, joint.JointScale, joint.Backlash, joint.LoadedPlay, joint.Hysteresis,
)  # fmt: skip
Basis = tuple[Mechanism, ...]


def joint_rivals(scene: Scene) -> Iterator[Basis]:
    """Mechanisms of single joints, each with the terms that it may mix."""
    for j in range(1, scene.arm.joints + 1):
        yield from ((kind(1e-4, j),) for kind in SINGLE)
        yield (joint.JointCompliance(1e-6, j),)
        if not scene.arm.prismatic[j - 1]:
            yield tuple(
                joint.TransmissionRipple(1e-4, j, once=(1.0 - k, p), twice=(float(k), p))
                for k in (0, 1)
                for p in (0.0, QUARTER)
            )
        for k in range(1, scene.arm.joints + 1):
            if k != j:
                yield (joint.JointCoupling(1e-4, j, k),)
            if k < j:
                yield (joint.CoupledPlay(1e-4, j, k),)


def body_rivals(scene: Scene) -> Iterator[Basis]:
    """Mechanisms of links, base and tool."""
    for i in range(1, scene.arm.joints + 1):
        yield tuple(body.LinkGeometry(1e-5, i, w) for w in _units(3))
        if np.hypot(scene.arm.a[i - 1], scene.arm.d[i - 1]) > 0.05:
            yield (body.LinkFlex(1e-7, i),)
        if i > 1 and not scene.arm.prismatic[i - 1]:
            yield (body.JointTilt(1e-7, i),)
    yield (body.LinkThermal(1e-6),)
    yield tuple(body.BaseDrift(1e-5, w) for w in _units(6))
    for moment in np.linspace(0.1, 0.9, 9):
        yield tuple(body.BaseBump(1e-5, w, float(moment)) for w in _units(6))
        yield tuple(end.ToolSlip(1e-5, (w,), (float(moment),)) for w in _units(3))
    yield tuple(end.ToolSlip(1e-5, w) for w in _shifts(scene))
    yield (body.BaseCompliance(1e-6, 1.0), body.BaseCompliance(1e-6, -1.0))
    axis = scene.tool[0] / np.linalg.norm(scene.tool[0])
    along = tuple(float(v) for v in axis)
    yield (end.NeedleSag(1e-5, along),)
    if scene.session.force is not None:
        yield (end.NeedleBending(1e-6, along),)
    stiffness = tuple(float(v) for v in np.where(scene.arm.prismatic, 1e9, 2e4))
    yield (joint.Payload(0.1, stiffness),)


def device_rivals() -> Iterator[Basis]:
    """Mechanisms of the device."""
    yield (end.SensorScale(1e-5),)
    yield (end.SensorDistortion(1e-5, "radial"),)
    yield (end.SensorDistortion(1e-5, "depth"),)
    yield (joint.Latency(1e-4),)


def _shifts(scene: Scene) -> Iterator[tuple[tuple[float, ...], ...]]:
    """Each group's tool but the first's along each axis, all others where they were."""
    groups = int(np.ptp(scene.session.group))
    for row in np.eye(3 * groups):
        yield tuple(tuple(float(v) for v in part) for part in row.reshape(groups, 3))


def _units(size: int) -> list[tuple[float, ...]]:
    return [tuple(float(v) for v in row) for row in np.eye(size)]


def always(case: Case) -> Array | None:
    """Columns of what is always fitted; None for a second encoder."""
    if case.observation == "joint_position":
        return None
    if case.sockets is not None:
        return gap.sockets_and_tool(case.scene, case.sockets)
    return gap.frame_and_tool(case.scene)


def confounded(
    case: Case, more: Sequence[Basis] = (), shift: Array | None = None, *, modelled: bool = True
) -> tuple[dict[str, object], ...]:
    """Rivals that the recording cannot tell from the truth, nearest first, besides `more` of them.

    Each with what it is confounded with (`of`), its `effect`, `element` and `separation`. ``shift``
    is what the truth really did to the readings, (N, 3) [m] or (N, n) [rad], where its mechanism is
    but an idea of it: what that leaves then counts for no rival. ``modelled`` says whether a
    library is expected to have the truth.
    """
    columns = always(case)
    allowed = offered(case.observation)
    rivals = [*joint_rivals(case.scene), *body_rivals(case.scene), *device_rivals()]
    rivals = [*(r for r in rivals if r[0].effect in allowed), *more]
    moved = [
        np.stack([gap.displacement(case.scene, (m,), case.observation).ravel() for m in r], axis=1)
        for r in rivals
    ]
    sizes = {r[0].effect: len(r) for r in rivals}
    found: dict[tuple[object, ...], dict[str, object]] = {}
    for truth in case.effects:
        target = gap.displacement(case.scene, (truth,), case.observation)
        own = 0.0
        if shift is not None:
            own = _left(shift, target.reshape(-1, 1), columns) if modelled else 0.0
            target = shift
        for rival, basis in zip(rivals, moved, strict=True):
            mine = (truth.effect, truth.element)
            key = (*mine, rival[0].effect, rival[0].element)
            if key[:2] == key[2:] or not basis.any():
                continue
            left = _left(target, basis, columns)
            richer = max(len(rival) - sizes.get(truth.effect, len(rival)), 0)
            separation = target.size * (left**2 - own**2) / case.noise_std**2
            separation += richer * float(np.log(target.size))
            known = found.get(key, {"separation": np.inf})
            if separation < min(ENOUGH, float(str(known["separation"]))):
                found[key] = {
                    "of": list(mine),
                    "effect": rival[0].effect,
                    "element": rival[0].element,
                    "separation": round(float(separation), 3),
                }
    return tuple(sorted(found.values(), key=lambda t: float(str(t["separation"]))))


def _left(target: Array, basis: Array, columns: Array | None) -> float:
    """What a rival leaves of a displacement, given the always-fitted columns."""
    return gap.unabsorbed(target, basis if columns is None else np.hstack([columns, basis]))
