"""The gap budget: how much of the error at a point each link of the chain contributes.

``sources`` says what a link does to the error there; ``shares`` adds links up, now and after the
cure, with intervals, and says so; ``spec`` reads a chain from a file.
"""

from plumbline.optim.budget.shares import Budget, Part, add_up
from plumbline.optim.budget.sources import Source
from plumbline.optim.budget.spec import read_budget

__all__ = ["Budget", "Part", "Source", "add_up", "read_budget"]
