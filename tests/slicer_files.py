"""Files as 3D Slicer writes them: points in mm, along LPS."""

import csv
import io
import json

HEADER = """# Markups fiducial file version = 4.13
# CoordinateSystem = LPS
# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID
"""


def write_points(path, table):
    """Write points [m] as a ``.mrk.json`` or a ``.fcsv``, by the name."""
    rows = table[["label", "description", "x", "y", "z"]].to_numpy().tolist()
    if path.name.endswith(".fcsv"):
        text = io.StringIO()
        text.write(HEADER)
        writer = csv.writer(text, lineterminator="\n")
        for k, (label, word, *p) in enumerate(rows, start=1):
            writer.writerow([k, *(1e3 * v for v in p), 0, 0, 0, 1, 1, 1, 0, label, word, ""])
        path.write_text(text.getvalue(), encoding="utf-8")
        return path
    points = [
        {"label": label, "description": word, "position": [1e3 * v for v in p]}
        for label, word, *p in rows
    ]
    markups = {"type": "Fiducial", "coordinateSystem": "LPS", "controlPoints": points}
    path.write_text(json.dumps({"markups": [markups]}), encoding="utf-8")
    return path
