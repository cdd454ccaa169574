"""The contract that every effect keeps, on several robots and kinds of observation."""

import dataclasses
import inspect
import re
from functools import cache
from pathlib import Path

import casadi as cs
import numpy as np
import pytest

import plumbline.kinematics.effects
from plumbline.errors import PlumblineError
from plumbline.kinematics.effects import EFFECTS, MOTION_EFFECTS, REGISTRY, Effect, Stage, State
from plumbline.kinematics.effects.effect import ALL_OBSERVATIONS
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.observation import build_model, rows_of, scope_of
from tests.benches import BENCHES, COLUMNS, T_DEVICE_BASE, bench, readings, residuals

MOST, FEW = 4, 3  # of an effect's candidates on one bench
OBSERVATIONS = (*ALL_OBSERVATIONS, "fiducials", "joint_torque")
OF_TORQUES = {"N m", "N m s/rad", "N m/rad", "kg m", "kg m^2"}
UNITS = {
    "m",
    "rad",
    "s",
    "kg",
    "N",
    "1",
    "1/K",
    "s/K",
    "rad/(N m)",
    "rad kg/(N m)",
    "rad/(N m)^2",
    "1/(N m^2)",
    "m/N",
    "m kg/N",
} | OF_TORQUES
OF_MOTION = {"friction"}  # shown by an arm that is measured while it moves alone
WITH_MEMORY = {"hysteresis"}
BOTH = pytest.mark.parametrize("where", BENCHES, ids="-".join)
EACH = pytest.mark.parametrize("name", REGISTRY)


@cache
def stage(where):
    """Recording, scope and registered nuisances of a bench."""
    recording = bench(*where)
    return recording, scope_of(recording), nuisances_of(recording)


@cache
def stated(where, effect):
    """A bench's problem with one effect and its functions, compiled once for all laws."""
    recording, _, nuisance = stage(where)
    model = build_model(recording, [effect], nuisance=nuisance)
    return model, Mapped(model.problem)


def at(model, values):
    """The unknowns with the effect's parameters at some values, nuisances at their start."""
    return np.concatenate([model.start[: model.fixed], values])


def variants(name, where):
    """Some candidates of an effect on a bench; another bench has others of them."""
    found = list(REGISTRY[name].candidates(stage(where)[1]))
    step = 1 + len(found) // MOST
    return found[BENCHES.index(where) % step :: step]


def offered(where, most=MOST):
    """Candidates of every effect on a bench, fewer of each where that will do."""
    found = [variants(name, where) for name in REGISTRY]
    return [e for few in found for e in (few if most == MOST else few[:: 1 + len(few) // most])]


def nulls(effect):
    return [p.null for p in effect.parameters]


def sizes(effect):
    return [p.null + p.scale for p in effect.parameters]


def classes():
    """Every concrete effect of the library, the variants in classes of their own among them."""
    todo, found = [Effect], []
    while todo:
        cls = todo.pop()
        todo += cls.__subclasses__()
        inside = cls.__module__.startswith("plumbline.kinematics.effects")
        if inside and not inspect.isabstract(cls) and hasattr(cls, "name"):
            found.append(cls)
    return found


@BOTH
def test_a_null_effect_changes_nothing(where):
    recording, scope, nuisance = stage(where)
    ideal = residuals(recording, nuisance=nuisance)
    rounding = 1e-15 * (scope.chain.reach + np.linalg.norm(T_DEVICE_BASE))
    for effect in offered(where):
        model, mapped = stated(where, effect)
        same = mapped.residuals(at(model, nulls(effect)))
        np.testing.assert_allclose(same, ideal, rtol=0, atol=rounding, err_msg=str(effect))


def powerless(effect, scope):
    """Whether a drive holds nothing: its axis is upright, or all that it carries lies on it."""
    if effect.name != "joint_compliance" or effect.effort:
        return False
    q = readings(scope.chain)
    tau = scope.chain.gravity_torque.map(len(q))(q.T, 3.0).full()
    return bool(np.abs(tau[effect.joint - 1]).max() < 1e-9)


def jacobian(mapped, x):
    """Jacobian of every row, unknown by unknown (P, N, m)."""
    return np.concatenate([J for _, _, J in mapped.jacobians(x)]).transpose(2, 0, 1)


@BOTH
def test_every_parameter_matters(where):
    """At its scale each moves some row by more than rounding, but for drives that hold nothing."""
    scope = stage(where)[1]
    for effect in offered(where):
        model, mapped = stated(where, effect)
        J = jacobian(mapped, model.start)
        moved = np.abs(J[model.fixed :]).max(axis=(1, 2)) * model.problem.scale[model.fixed :]
        assert (moved > 1e-9).all() != powerless(effect, scope), f"{effect}: {moved}"


def finite_differences(mapped, x, steps):
    """Central differences of fourth order, in steps: (P, N, m)."""
    rows = []
    for k, step in enumerate(steps):
        at = {h: mapped.residuals(x + h * step * np.eye(len(x))[k]) for h in (-2, -1, 1, 2)}
        rows.append((8 * (at[1] - at[-1]) - (at[2] - at[-2])) / 12)
    return np.array(rows)


@BOTH
def test_the_symbolic_jacobian_is_that_of_finite_differences(where):
    for effect in offered(where, FEW):
        model, mapped = stated(where, effect)
        x = model.start.copy()
        x[model.fixed :] += 0.5 * model.problem.scale[model.fixed :]
        steps = np.minimum(0.1 * model.problem.scale, 1e-3)
        J = jacobian(mapped, x) * steps[:, None, None]
        differences = finite_differences(mapped, x, steps)
        np.testing.assert_allclose(J, differences, rtol=1e-6, atol=1e-13, err_msg=str(effect))


@BOTH
def test_rows_of_an_effect_without_memory_know_nothing_of_each_other(where):
    recording = stage(where)[0]
    order = np.random.default_rng(3).permutation(len(recording))
    for effect in offered(where, FEW):
        model, mapped = stated(where, effect)
        x = at(model, sizes(effect))
        forward = mapped.residuals(x)
        rows = rows_of(recording.select(order), [effect])
        shuffled = Mapped(model.problem.on(rows)).residuals(x)
        same = np.abs(shuffled - forward[order]).max() < 1e-14
        remembers = effect.name in WITH_MEMORY or getattr(effect, "way", 0.0) > 0.0
        assert same != remembers, effect


@EACH
def test_an_effect_offers_itself_somewhere(name):
    found = {where: variants(name, where) for where in BENCHES}
    assert any(found.values())
    for where, effects in found.items():
        assert all(where[1] in effect.observations for effect in effects)
        shown = name not in OF_MOTION or stage(where)[1].moving
        seen = where[1] in REGISTRY[name].observations
        if (name, where[1]) == ("sensor_scale", "fixed_point"):
            seen = "distance" in stage(where)[1].span  # which alone measures there
        if name == "screw_ripple":
            seen = stage(where)[1].arm and "prismatic" in stage(where)[1].chain.kinds
        assert bool(effects) == (seen and shown)


@pytest.mark.parametrize("missing", [*COLUMNS, "all"])
@pytest.mark.parametrize("observation", ["tip_position", "joint_position"])
def test_an_effect_asks_for_no_column_that_is_not_there(missing, observation):
    """Nothing is offered without what it needs, and whatever is offered can be stated."""
    left = [] if missing == "all" else [c for c in COLUMNS if c != missing]
    recording = bench("laparoscopic", observation, columns=left)
    scope, nuisance = scope_of(recording), nuisances_of(recording)
    assert scope.columns == frozenset(left)
    whole = stage(("laparoscopic", observation))[1]
    for cls in EFFECTS:
        known = set(cls.candidates(whole)) if missing != "all" else set()
        found = list(cls.candidates(scope))
        assert all(scope.has(*effect.needs) for effect in found)
        if cls.lacks(scope):
            assert not found
        for effect in found[:: 1 + len(found) // MOST]:
            model = build_model(recording, [effect], nuisance=nuisance)  # of what is there alone
            if effect not in known:
                values = Mapped(model.problem).residuals(at(model, sizes(effect)))
                assert np.isfinite(values).all(), effect


def test_what_lives_on_a_column_is_gone_with_it():
    """The effects that fall silent when a column is taken away: those that declare the need."""
    full = {e.name for e in EFFECTS if e.candidates(scope_of(bench("sweeping", "tip_position")))}
    for column in COLUMNS:
        left = [c for c in COLUMNS if c != column]
        scope = scope_of(bench("sweeping", "tip_position", columns=left))
        gone = full - {e.name for e in EFFECTS if e.candidates(scope)}
        assert gone == {
            e.name for e in EFFECTS if column in e.needs and column not in e.needs_one_of
        }
    seen = {e.name for e in EFFECTS if "tip_position" in e.observations}
    assert full == seen - {"screw_ripple"}  # of joints that slide, of which this arm has none
    assert {"base_drift", "base_bump", "respiration"} <= {
        e.name for e in EFFECTS if "time" in e.needs
    }


def test_no_effect_of_weight_is_offered_without_gravity():
    recording = bench("ur5", "tip_position", columns=["time"])
    scope = scope_of(recording)
    chain = recording.robot.with_gravity([0.0, 0.0, 0.0]).chain()
    weightless = dataclasses.replace(scope, chain=chain)
    silent = {e.name for e in EFFECTS if e.candidates(scope) and not e.candidates(weightless)}
    assert silent == {
        "joint_compliance", "joint_tilt", "link_flex", "base_compliance", "needle_sag", "payload",
        "backlash",
    }  # fmt: skip


@EACH
def test_a_candidate_is_frozen_hashable_and_one_of_a_kind(name):
    for where in BENCHES:
        found = list(REGISTRY[name].candidates(stage(where)[1]))
        assert len(set(found)) == len(found)
        for effect in found[:3]:
            assert effect.name == name
            assert effect == dataclasses.replace(effect)
            assert hash(effect) == hash(dataclasses.replace(effect))
            for field in dataclasses.fields(effect):
                with pytest.raises(dataclasses.FrozenInstanceError):
                    setattr(effect, field.name, getattr(effect, field.name))


@BOTH
def test_an_element_is_one_of_the_arm_s(where):
    scope = stage(where)[1]
    for effect in offered(where):
        if effect.element is None:
            assert effect.label == effect.name
        else:
            of_parts = effect.stage in (Stage.REGISTRATION, Stage.SENSOR)
            assert 1 <= effect.element <= (scope.elements if of_parts else scope.chain.n)
            assert effect.label == f"{effect.name} {effect.element}"


@BOTH
def test_a_variant_is_words_that_stand_in_a_list(where):
    for effect in offered(where):
        assert effect.variant == effect.variant.strip(" :;,."), effect


@BOTH
def test_neighbours_are_variants_of_the_same_cause(where):
    _, scope, _ = stage(where)
    for effect in offered(where):
        near = list(effect.neighbours(scope))
        assert effect not in near
        assert len(set(near)) == len(near)
        for other in near:
            assert type(other) is type(effect)
            assert (other.name, other.element) == (effect.name, effect.element)
            fewer = min(len(other.parameters), len(effect.parameters))
            assert other.parameters[:fewer] == effect.parameters[:fewer]


@BOTH
def test_derived_columns_are_one_finite_number_a_row(where):
    recording, _, _ = stage(where)
    own = {"q": recording.q, **{c: getattr(recording, c) for c in COLUMNS}}
    for effect in offered(where):
        columns = effect.derive(own)
        assert not set(columns) & set(own)
        for values in columns.values():
            assert values.shape == (len(recording),)
            assert np.isfinite(values).all()


def test_derived_columns_of_two_variants_never_share_a_name():
    recording, scope, _ = stage(BENCHES[0])
    path = {"q": recording.q, "time": recording.time, "temperature": recording.temperature}
    names = [
        column
        for cls in EFFECTS
        for effect in cls.candidates(scope)
        for each in (effect, *effect.neighbours(scope))
        for column in each.derive({name: values[:2] for name, values in path.items()})
    ]
    assert len(names) > 18
    found = set(REGISTRY["hysteresis"].candidates(scope))
    found |= {near for effect in found for near in effect.neighbours(scope)}
    lags = {(e.joint, round(e.width, 9), e.start) for e in found}
    assert len(set(names) - {"warming"}) == len(lags)


@BOTH
def test_effects_add_up_whatever_their_order_in_the_list(where):
    recording, _, nuisance = stage(where)
    few = [variants(name, where)[0] for name in REGISTRY if variants(name, where)]
    values = {effect: sizes(effect) for effect in few}
    forward = residuals(recording, few, np.concatenate([values[e] for e in few]), nuisance)
    back = few[::-1]
    backward = residuals(recording, back, np.concatenate([values[e] for e in back]), nuisance)
    # Two sensor effects, or two of one link, do not commute exactly: second order.
    np.testing.assert_allclose(backward, forward, atol=2e-4 if where[0] != "kr300" else 5e-3)
    everything_off = residuals(recording, few, np.concatenate([nulls(e) for e in few]), nuisance)
    np.testing.assert_allclose(everything_off, residuals(recording), atol=2e-14)


@pytest.mark.parametrize("cls", classes(), ids=lambda cls: cls.__name__)
def test_a_declaration_is_complete(cls):
    assert REGISTRY[cls.name] is cls or issubclass(cls, REGISTRY[cls.name].__mro__[1])
    assert isinstance(cls.stage, Stage)
    assert cls().port in Stage
    assert set(cls.observations) <= set(OBSERVATIONS)
    assert set(cls.needs) | set(cls.needs_one_of) <= set(COLUMNS)
    assert len(cls.needs_one_of) != 1, "one column that will do is a column that it needs"
    assert re.search(r"\(\d{4}\)", cls.reference), "a reference has its year in brackets"
    assert "{" not in cls().sentence
    assert ("{element}" in cls.words) == (cls().element is not None)
    assert cls.__doc__
    assert inspect.getmodule(cls).__doc__
    assert cls.declared


@pytest.mark.parametrize("cls", classes(), ids=lambda cls: cls.__name__)
def test_a_parameter_says_its_unit_and_its_bounds_hold_its_null(cls):
    for parameter in cls.declared:
        assert getattr(cls, parameter.name) is parameter
        assert parameter.unit in UNITS, (
            f"{cls.name}, {parameter.name}: unit {parameter.unit!r} is not among "
            f"{', '.join(sorted(UNITS))}; mend it, or add it to UNITS in this file and, with the "
            "unit that readers are shown, to SHOWN in optim/diagnosis/verdict/words.py"
        )
        assert parameter.doc
        assert parameter.source, f"{cls.name}, {parameter.name}: say where its scale is from"
        assert parameter.lower <= parameter.null <= parameter.upper
        assert parameter.null + parameter.scale <= parameter.upper
        assert np.isfinite([parameter.lower, parameter.upper]).all()
    assert len({p.name for p in cls.declared}) == len(cls.declared)


@pytest.mark.parametrize("cls", classes(), ids=lambda cls: cls.__name__)
def test_what_is_scanned_is_a_field(cls):
    fields = {field.name for field in dataclasses.fields(cls)}
    assert cls.scanned is None or cls.scanned in fields
    found = [effect for where in BENCHES for effect in cls.candidates(stage(where)[1])]
    if cls.scanned is not None:
        assert len({getattr(e, cls.scanned) for e in found if type(e) is cls}) > 50


def test_an_effect_s_file_is_called_like_it_and_every_file_is_registered():
    folder = Path(plumbline.kinematics.effects.__file__).parent
    files = {path.stem for path in folder.glob("*.py")} - {
        "__init__",
        "effect",
        "drive",
        "motion_effect",
        "confined",
    }
    assert files == set(REGISTRY) | {cls.name for cls in MOTION_EFFECTS}
    for name, cls in REGISTRY.items():
        assert Path(inspect.getfile(cls)).stem == name
    assert len(REGISTRY) == len(EFFECTS)


def test_state_is_changed_by_copy():
    recording, scope, _ = stage(("sweeping", "tip_position"))
    others = {where[1]: stage(where)[1] for where in BENCHES}
    torques = others["joint_torque"]
    motion = ("q", "direction", "velocity", "effort", "acceleration", "turning")
    row = {name: cs.SX.sym(name, torques.chain.n) for name in motion}
    scalars = ("time", "temperature", "payload", "group", "element", "play1_0.0001_None")
    row |= {"force": cs.SX.sym("force", 3), **{name: cs.SX.sym(name) for name in scalars}}
    for cls in EFFECTS:
        seen = scope if "tip_position" in cls.observations else others[cls.observations[0]]
        if not cls.candidates(seen):
            seen = stage(("laparoscopic", "tip_position"))[1]  # of a joint that slides
        effect = next(iter(cls.candidates(seen)))
        symbols = {k: s if k == "force" else s[: seen.chain.n] for k, s in row.items()}
        state = State.ideal(seen.chain, symbols, cs.SX(recording.tool_offset))
        state = dataclasses.replace(  # as where torques are measured
            state, inertial=cs.SX.sym("p", 7, 10), torque=cs.SX.sym("t", 7), carried=cs.SX(7, 1)
        )
        before = {f.name: str(getattr(state, f.name)) for f in dataclasses.fields(state)}
        effect.apply(state, *[cs.SX.sym(p.name) for p in effect.parameters])
        assert {f.name: str(getattr(state, f.name)) for f in dataclasses.fields(state)} == before


@dataclasses.dataclass(frozen=True)
class OfOneJoint(Effect):
    """An effect of one's own that says of which joint it is, and not which joints to try."""

    joint: int

    stage = Stage.JOINT
    observations = ALL_OBSERVATIONS

    def apply(self, state, *_):
        return state


def test_an_effect_that_says_no_variants_is_refused_with_the_way_out():
    with pytest.raises(PlumblineError, match=r"found joint without a default.* JointEffect"):
        OfOneJoint.candidates(scope_of(bench("ur5", "tip_position")))
