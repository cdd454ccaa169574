"""Whether what is scanned of a dense family is what a model of each of its variants has."""

import numpy as np

from plumbline.kinematics.effects import REGISTRY
from plumbline.optim.core.mapped import Mapped
from plumbline.optim.diagnosis.posterior.scan import families
from plumbline.optim.measurement.nuisance import nuisances_of
from plumbline.optim.measurement.observation import build_model, scope_of


def scanned_as_modelled(name, recording):
    """Blocks of some variants of an effect, scanned and of a model, about no other effect."""
    nuisance = nuisances_of(recording)
    alone = build_model(recording, (), nuisance=nuisance)
    variants = [e for e in REGISTRY[name].candidates(scope_of(recording)) if e.scanned][::60]
    found, _ = families(alone, alone.start, np.zeros(60, dtype=int), variants)
    for family in found:
        for v, effect in enumerate(family.effects):
            model = build_model(recording, (effect,), nuisance=nuisance)
            [gram] = Mapped(model.problem).grams(model.start, np.zeros(60, dtype=int))
            P, scale = alone.problem.size, model.problem.scale
            G = (gram.matrix * np.outer(scale, scale))[P:, P:]
            np.testing.assert_allclose(family.blocks[0, v], G, rtol=1e-9, atol=1e-12 * G.max())
