"""Run notebooks and store them with light outputs: ``python docs/store_notebooks.py FILE...``.

Pictures are brought to 256 colours or fewer; times of day are not recorded. What is light is held
by ``tests/house/test_notebooks.py``.
"""

import base64
import io
import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from PIL import Image

COLOURS = 256  # of a palette: on plain paper no difference is seen, at a third of the size


def lighter(png: str) -> str:
    """The same picture with a palette of its own, both as Base64."""
    picture = Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB")
    buffer = io.BytesIO()
    picture.quantize(COLOURS).save(buffer, format="PNG", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode()


def store(path: Path) -> None:
    """Run a notebook where it lies and write it back."""
    notebook = nbformat.read(path, as_version=4)
    place = {"metadata": {"path": str(path.parent)}}
    NotebookClient(notebook, timeout=None, resources=place, record_timing=False).execute()
    for cell in notebook.cells:
        for output in cell.get("outputs", ()):
            data = output.get("data", {})
            if "image/png" in data:
                data["image/png"] = lighter(data["image/png"])
    notebook.metadata["language_info"] = {"name": "python"}
    nbformat.write(notebook, path)


for name in sys.argv[1:]:
    store(Path(name))
