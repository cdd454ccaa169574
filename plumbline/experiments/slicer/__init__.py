"""Points of 3D Slicer, ``.mrk.json`` and ``.fcsv``, and transforms from and to it, ITK's ``.tfm``.

Slicer's files are in mm; here lengths are in m. A file says whether its axes point left, posterior,
superior (LPS, the rule of DICOM and ITK) or right, anterior, superior (RAS, Slicer's inside); the
two differ by the sign of x and y, which is half a turn about z and no mirror image.
"""

from plumbline.errors import PlumblineError as PlumblineError
from plumbline.experiments.slicer.points import axes_changed as axes_changed
from plumbline.experiments.slicer.points import points_table as points_table
from plumbline.experiments.slicer.points import read_fcsv as read_fcsv
from plumbline.experiments.slicer.points import read_markups as read_markups
from plumbline.experiments.slicer.points import read_points as read_points
from plumbline.experiments.slicer.points import to_fiducials as to_fiducials
from plumbline.experiments.slicer.tfm import read_tfm as read_tfm
from plumbline.experiments.slicer.tfm import tfm_text as tfm_text
