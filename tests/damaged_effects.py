"""Plugin of pytest: every effect is half as strong again as told; which tests notice?

``pytest -p tests.damaged_effects FILES`` prints the effects that stood alone in a test that failed.
"""

import pytest

from plumbline.kinematics.effects import REGISTRY
from plumbline.kinematics.effects.effect import Effect

TOO_STRONG = 1.5
applied, noticed = set(), set()


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


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    if report.when == "call":
        alone = applied & set(REGISTRY)
        if report.failed and len(alone) == 1:
            noticed.update(alone)
        applied.clear()
    return report


def pytest_terminal_summary(terminalreporter):
    terminalreporter.write_line(f"noticed: {' '.join(sorted(noticed))}")
