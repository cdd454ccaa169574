"""Plugin of pytest: every effect is half as strong again as told; which tests notice?

``pytest -p tests.damaged_effects FILES`` prints the effects that stood alone in a test that failed.
"""

import pytest

from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.effects.effect import Effect

TOO_STRONG = 1.5
applied, noticed, seen = set(), set(), set()


def damaged(apply):
    def stronger(self, state, *values):
        applied.add(self.name)
        nulls = [p.null for p in self.parameters]
        grown = [n + TOO_STRONG * (v - n) for v, n in zip(values, nulls, strict=True)]
        return apply(self, state, *grown)

    return stronger


def pytest_configure():
    todo = [Effect]
    while todo:
        cls = todo.pop()
        todo += cls.__subclasses__()
        if "apply" in vars(cls) and cls is not Effect:
            cls.apply = damaged(cls.apply)


def pytest_runtest_setup(item):
    """One robot will do of a law that was tried on several."""
    given = item.callspec.params.values() if hasattr(item, "callspec") else ()
    own = any(isinstance(value, str) and value in REGISTRY for value in given)
    if item.originalname in seen and not own:
        pytest.skip("seen")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    if report.when == "call":
        alone = applied & set(REGISTRY)
        if report.failed and len(alone) == 1:
            noticed.update(alone)
            seen.add(item.originalname)
        applied.clear()
    return report


def pytest_terminal_summary(terminalreporter):
    terminalreporter.write_line(f"noticed: {' '.join(sorted(noticed))}")
