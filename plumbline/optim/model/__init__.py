"""What a diagnosis found, to take home: where the tip is, what to command, files for others.

``rows`` and ``fitted`` hold it as data; ``statement`` and ``arm`` evaluate
it; ``command`` inverts it; ``stored`` keeps it; ``export`` writes it for others;
``apply`` tries it on another recording, ``driven`` either kind; ``making`` takes it from a fit.
``drives`` is the same of motions.
"""

from plumbline.optim.model.apply import Applied, Change
from plumbline.optim.model.command import Command
from plumbline.optim.model.driven import apply
from plumbline.optim.model.drives import Drives
from plumbline.optim.model.fitted import Known
from plumbline.optim.model.model import Model

__all__ = ["Applied", "Change", "Command", "Drives", "Known", "Model", "apply"]
