"""The joint posterior about a fit to what it itself finds: linearised anew until the two agree.

All probabilities are of one linear problem. Where a fit to what is named is another than it
foretold, effects that bend each other were linearised too far off. So they were where a fit holds
effects that the most probable state does without, with something unlisted in their place: a fit
without them tells as well by how much the problem errs.
"""

from dataclasses import replace

import numpy as np

from plumbline.kinematics.evaluate import Flags
from plumbline.optim.diagnosis import prior
from plumbline.optim.diagnosis.posterior import search
from plumbline.optim.diagnosis.predict.negligible import worth_while
from plumbline.optim.diagnosis.verdict.explanation import Explanation, explain
from plumbline.optim.diagnosis.verdict.terms import with_terms


def settled(
    task: search.Task, selected: search.SelectedModel, bad: Flags, seed: int, unlisted: float
) -> tuple[search.SelectedModel, Explanation]:
    """The model of what is named and worth while, and all probabilities.

    All is linearised anew about the fit that the problem errs most about, as long as that brings
    the two nearer to each other by half. Of the rows that were compared alone: what all rows of a
    long recording tell is no matter of the probabilities. One that is searched in part first is
    linearised once here, as it was in its search: its terms are those of that.

    Args:
        task: What was searched: its rows (N) are fitted again.
        selected: Where the search ended.
        bad: Which rows are taken for gross errors (N,).
        seed: Of the chains.
        unlisted: Prior probability that a term is of no effect of the library.
    """
    before, about = np.inf, selected
    for left in reversed(range(1 if task.long else prior.ROUNDS)):
        told = explain(about, seed, unlisted)
        fitted, wrong = _fitted(about, told, task, bad)
        near = fitted
        if left and not told.one_by_one:
            near, wrong = _farthest(about, told, (fitted, wrong), task, bad)
        if wrong < before:
            selected, explanation = fitted, told
        if not left or wrong < prior.NO_EVIDENCE or not wrong <= 0.5 * before:
            break
        before, about = wrong, search.about_its_fit(near, task.library)
    return selected, explanation


def _fitted(
    about: search.SelectedModel, told: Explanation, task: search.Task, bad: Flags
) -> tuple[search.SelectedModel, float]:
    """The model of what is worth while, and by how much the linear problem errs about it [nats].

    What chains came to is taken if it is better by more than that.
    """
    for terms, better in ((told.theirs, told.better), (told.terms, np.inf)):
        if better > 0.0:
            kept = worth_while(about, terms, told.named)
            fitted = with_terms(about, kept, task, bad, tried=terms)
            wrong = _share(told, task) * search.foretold_wrongly(fitted)
            if wrong < better:
                break
    return fitted, wrong


def _farthest(
    about: search.SelectedModel,
    told: Explanation,
    fitted: tuple[search.SelectedModel, float],
    task: search.Task,
    bad: Flags,
) -> tuple[search.SelectedModel, float]:
    """That model, or the one without what the most probable state lacks: the worse foretold."""
    model, wrong = fitted
    keys, candidates = about.selection.keys(told.likeliest), about.selection.candidates
    held = [t for t in model.chosen if candidates[t.index].key in keys]
    if len(held) == len(model.chosen):
        return fitted
    bare = with_terms(about, held, task, bad)
    off = _share(told, task) * search.foretold_wrongly(bare)
    return (replace(bare, excluded=model.excluded), off) if off > wrong else fitted


def _share(told: Explanation, task: search.Task) -> float:
    """The share of the rows that were compared."""
    return told.compared / len(task.recording) if told.compared else 1.0
