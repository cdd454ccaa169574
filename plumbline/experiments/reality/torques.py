"""Cases of measured efforts: what is wrong in drives and bodies, the recording and its truth.

A mechanism is worked out at the strength that the ratio of its own gap to the noise asks for: root
mean square over the joints that it moves, each in units of its own noise.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.arm import Array
from plumbline.experiments.reality.cases import Plan
from plumbline.experiments.reality.ranges import Ranges
from plumbline.experiments.reality.recorder import Recording, numbered, write
from plumbline.experiments.reality.torque_arm import Build, Course, G, draw_build, draw_course

RANGES = Ranges("torque")
ROWS = 4  # rows here for each row of a plan: neighbours are 20 ms apart
VELOCITY_NOISE = 2e-3  # of the fastest
ALIKE = 3.0  # log likelihood that a rival may lack
MOST = 1.5  # of a joint's largest effort: no mechanism exerts more
OF_JOINTS = (
    "coulomb_friction", "viscous_friction", "stribeck_friction", "load_friction", "rotor_inertia",
    "torque_scale", "torque_offset", "cable_spring",
)  # fmt: skip
INSIDE = (*OF_JOINTS, "payload", "link_inertia", "gravity_direction")
BEYOND = ("cogging", "heating", "bristles", "coupled_current")
SMALL = 1e-4  # strength at which a mechanism of the bodies is linear


@dataclass(frozen=True)
class Mechanism:
    """Something wrong: its name, its joint or link from 1, and what it adds at unit strength."""

    effect: str
    element: int | None
    basis: Array  # (k, N, n) [N m]: one mechanism may have several strengths
    rebuilt: Callable[[float], Build] | None = None  # the arm at a strength, where that bends it
    depends_on: tuple[str, ...] = ()


@dataclass(frozen=True)
class Bench:
    """An arm, its motion and the efforts of the arm as drawn."""

    build: Build
    course: Course
    tau: Array  # (N, n) [N m]

    def of(self, changed: Build, step: float = 1.0) -> Array:
        """What another build takes more (N, n) [N m], over the step."""
        c = self.course
        return np.asarray((changed.efforts(c.q, c.v, c.a) - self.tau) / step)

    def alone(self, j: int, torque: Array) -> Array:
        """A torque (N,) of joint j alone (1, N, n)."""
        found = np.zeros_like(self.tau)
        found[:, j] = torque
        return found[None]


def joint_mechanism(bench: Bench, name: str, j: int, slow: float = 0.1) -> Mechanism:
    """A mechanism of joint j (from 0)."""
    c, tau = bench.course, bench.tau[:, j]
    v, sign = c.v[:, j], np.tanh(c.v[:, j] / (2e-3 * np.abs(c.v[:, j]).max()))
    shapes: dict[str, Callable[[], list[Array]]] = {
        "coulomb_friction": lambda: [sign],
        "viscous_friction": lambda: [v],
        "stribeck_friction": lambda: [sign * np.exp(-((v / (slow * np.abs(v).max())) ** 2))],
        "load_friction": lambda: [sign * np.abs(tau)],
        "rotor_inertia": lambda: [c.a[:, j]],
        "torque_scale": lambda: [tau],
        "torque_offset": lambda: [np.ones(len(v))],
        "cable_spring": lambda: [c.q[:, j], np.ones(len(v))],
    }
    parts = np.concatenate([bench.alone(j, part) for part in shapes[name]()])
    return Mechanism(name, j + 1, parts)


def body_mechanism(bench: Bench, name: str, i: int = 0) -> Mechanism:
    """A mechanism of a link i (from 0), the load or gravity."""
    b, n = bench.build, bench.build.joints
    if name == "link_inertia":
        builds = [b.with_link(i, SMALL, np.zeros(3))]
        builds += [b.with_link(i, 0.0, SMALL * unit) for unit in np.eye(3)]
        return Mechanism(name, i + 1, np.stack([bench.of(x, SMALL) for x in builds]))
    if name == "gravity_direction":
        turned = [(G * SMALL, 0.0, -G), (0.0, G * SMALL, -G)]
        moved = [bench.of(replace(b, gravity=g), SMALL) for g in turned]
        return Mechanism(name, None, np.stack(moved))
    reach = b.links[n - 1].length
    one = bench.of(replace(b, load=(1.0, 0.0, 0.0, 0.0)))
    offs = [bench.of(replace(b, load=(1.0, *(reach * unit)))) - one for unit in np.eye(3)]
    return Mechanism("payload", None, np.stack([one, *offs]))


def outside_mechanism(bench: Bench, name: str, j: int, rng: np.random.Generator) -> Mechanism:
    """What no library of drives lists, at joint j (from 0)."""
    c, tau = bench.course, bench.tau[:, j]
    q, on = c.q[:, j], (f"q{j + 1}",)
    if name == "cogging":
        order = RANGES.whole("cogging_order", rng)
        shape = np.sin(order * q + RANGES.one("cogging_phase", rng))
    elif name == "heating":
        shape, on = tau * (c.time / c.time[-1]) ** 2, ("time",)
    elif name == "bristles":
        shape, on = _bristles(q, 0.15 * float(np.ptp(q))), (f"motion of q{j + 1}",)
    else:
        other = (j + 1) % bench.build.joints
        shape, on = bench.tau[:, other], (f"load {other + 1}",)
    return Mechanism(name, j + 1, bench.alone(j, shape), depends_on=on)


def _bristles(q: Array, way: float) -> Array:
    """Dry friction that builds up over a way [rad], after Dahl."""
    z = np.zeros(len(q))
    for k in range(1, len(q)):
        step = q[k] - q[k - 1]
        z[k] = np.clip(z[k - 1] + step / way * (1 - np.sign(step) * z[k - 1]), -1, 1)
    return z


def drawn(bench: Bench, name: str, rng: np.random.Generator) -> Mechanism:
    """One mechanism at random strengths of its own, as one shape (1, N, n)."""
    n = bench.build.joints
    j = int(rng.integers(n))
    if name in BEYOND:
        return outside_mechanism(bench, name, j, rng)
    if name in OF_JOINTS:
        found = joint_mechanism(bench, name, j, slow=RANGES.one("slow", rng))
    else:
        found = body_mechanism(bench, name, int(rng.integers(1, n)))
    if name == "payload":  # a mass hangs within half a link of the tip
        place = bench.build.links[-1].length * RANGES.many("hangs", rng, 3)
        held = replace(bench.build, load=(1.0, place[0], place[1], place[2]))
        return replace(found, basis=bench.of(held)[None])
    weights = rng.normal(size=len(found.basis))
    weights /= np.sqrt(np.mean(found.basis**2, axis=(1, 2))) + 1e-12
    if name == "link_inertia":
        share, shift, i = float(weights[0]), weights[1:], int(found.element or 1) - 1
        whole = partial(_changed_link, bench.build, i, share, shift)
        return replace(found, basis=_summed(weights, found.basis), rebuilt=whole)
    if name == "gravity_direction":
        whole = partial(_tilted, bench.build, weights)
        return replace(found, basis=_summed(weights, found.basis), rebuilt=whole)
    if name not in ("torque_scale", "torque_offset"):  # all else is above zero
        weights[0] = abs(weights[0])
    return replace(found, basis=_summed(weights, found.basis))


def _summed(weights: Array, basis: Array) -> Array:
    return np.asarray(np.einsum("k,knj->nj", weights, basis)[None])


def _changed_link(build: Build, i: int, share: float, shift: Array, strength: float) -> Build:
    if not -0.8 < strength * share < 3.0:
        raise PlumblineError(f"link {i + 1} would weigh {1 + strength * share:.2g} times its mass")
    if np.abs(strength * shift).max() > build.links[i].length:
        raise PlumblineError(f"link {i + 1}: its centre would leave it")
    return build.with_link(i, strength * share, strength * shift)


def _tilted(build: Build, weights: Array, strength: float) -> Build:
    x, y = strength * weights
    if np.hypot(x, y) > 0.5:
        raise PlumblineError(f"a base tilted by {np.hypot(x, y):.2g} rad")
    down = np.array([x, y, -1.0]) * G / np.sqrt(1.0 + x**2 + y**2)
    return replace(build, gravity=(down[0], down[1], down[2]))


def rivals(bench: Bench) -> Iterator[Mechanism]:
    """All that the library may have, each with all of its strengths."""
    n = bench.build.joints
    for j in range(n):
        yield from (joint_mechanism(bench, name, j) for name in OF_JOINTS)
        yield body_mechanism(bench, "link_inertia", j)
    yield body_mechanism(bench, "payload")
    yield body_mechanism(bench, "gravity_direction")


def confounded(bench: Bench, truth: Mechanism, gap: Array, sigma: Array) -> list[dict[str, object]]:
    """Rivals that explain the gap (N, n) up to what noise (n,) hides."""
    target = (gap / sigma).ravel()
    found: list[dict[str, object]] = []
    for rival in rivals(bench):
        if (rival.effect, rival.element) == (truth.effect, truth.element):
            continue
        columns = (rival.basis / sigma).reshape(len(rival.basis), -1).T
        left = target - columns @ np.linalg.lstsq(columns, target, rcond=1e-9)[0]
        lost = 0.5 * float(left @ left)
        if lost < ALIKE:
            found.append({
                "of": [truth.effect, truth.element], "effect": rival.effect,
                "element": rival.element, "separation": lost,
            })  # fmt: skip
    return found


def simulate_torques(folder: Path, plan: Plan, name: str, seed: int) -> dict[str, object]:
    """Move an arm, write its efforts; the truth (PlumblineError: more than any drive exerts)."""
    rng = np.random.default_rng([seed, 13])
    build = draw_build(rng)
    rows = ROWS * int(rng.integers(plan.rows[0], plan.rows[1] + 1))
    course = draw_course(build.joints, rows, rng)
    bench = Bench(build, course, build.efforts(course.q, course.v, course.a))
    most = np.abs(bench.tau).max(axis=0)
    most = np.maximum(most, 0.01 * most.max())
    sigma = most * RANGES.many("noise", rng, build.joints)
    names = _names(plan, rng)
    found, gaps, alike = [], [], []
    total = np.zeros_like(bench.tau)
    for effect in names:
        mechanism = drawn(bench, effect, rng)
        ratio = float(np.exp(rng.uniform(*np.log(plan.gap))))
        shape = mechanism.basis[0]
        busy = np.abs(shape).max(axis=0) > 1e-9 * np.abs(shape).max()
        strength = ratio / float(np.sqrt(np.mean((shape / sigma)[:, busy] ** 2)))
        gap = shape * strength
        if mechanism.rebuilt is not None:
            gap = bench.of(mechanism.rebuilt(strength))
            ratio = float(np.sqrt(np.mean((gap / sigma)[:, busy] ** 2)))
        if (np.abs(gap).max(axis=0) > MOST * most).any():
            raise PlumblineError(f"{name}: {effect} of {np.abs(gap).max():.2g} N m")
        total += gap
        found.append(mechanism)
        gaps.append(ratio)
        alike += confounded(bench, mechanism, gap, sigma) if plan.kind != "outside" else []
    noise = rng.normal(0.0, sigma, bench.tau.shape)
    _write(folder, name, bench, sigma, total + noise, known=plan.known_noise, rng=rng)
    return {
        "name": name, "kind": plan.kind, "observation": "joint_torque", "rows": rows,
        "effects": [
            {"effect": m.effect, "element": m.element, "gap_to_noise": g,
             "parameters": {"depends_on": list(m.depends_on), "stage": "actuation"}}
            for m, g in zip(found, gaps, strict=True)
        ],
        "noise_std": float(np.sqrt(np.mean(sigma**2))),
        "noise_rms": float(np.sqrt(np.mean(noise**2))),
        "confounded": alike, "seed": seed, "arm": f"{build.joints} joints", "simulator": "torque",
    }  # fmt: skip


def _names(plan: Plan, rng: np.random.Generator) -> list[str]:
    allowed = BEYOND if plan.kind == "outside" else INSIDE
    names = [n for n in allowed if not plan.effects or n in plan.effects]
    count = {"none": 0, "pair": 2}.get(plan.kind, 1)
    return [str(n) for n in rng.choice(names, count, replace=False)]


def _write(
    folder: Path,
    name: str,
    bench: Bench,
    sigma: Array,
    more: Array,
    *,
    known: bool,
    rng: np.random.Generator,
) -> None:
    """Columns as a robot's logger writes them: no accelerations, velocities with their noise."""
    c = bench.course
    fastest = VELOCITY_NOISE * np.abs(c.v).max(axis=0)
    velocity = c.v + rng.normal(0.0, fastest, c.v.shape)
    columns = {"time": c.time}
    for prefix, values in (("q", c.q), ("velocity", velocity), ("effort", bench.tau + more)):
        columns |= numbered(prefix, values)
    noises = ", ".join(f"{s:.6g}" for s in sigma)
    stated = f"noise_std = [{noises}]\n" if known else ""
    text = (
        f'name = "{name}"\nobservation = "joint_torque"\n\n[robot]\nurdf = "robot.urdf"\n'
        f'tip_frame = "flange"\n\n[motion]\neffort_unit = "N m"\n{stated}'
    )
    write(folder, Recording(text, columns))
    (folder / "robot.urdf").write_text(bench.build.urdf(), encoding="utf-8")
