"""Runs the cells of docs/tutorial.ipynb and keeps what they show.

    python scripts/tutorial.py

Nothing is kept that tells of the machine: no times, no version of Python.
"""

from base64 import b64decode, b64encode
from io import BytesIO
from pathlib import Path

import nbformat
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient
from nbformat import NotebookNode
from PIL import Image

from lss_core.files import write_atomically

TUTORIAL = Path(__file__).parents[1] / "docs" / "tutorial.ipynb"


def run_cells(path: Path) -> NotebookNode:
    """The notebook with what its cells show now, run in its folder by this Python.

    Raises:
        CellExecutionError: If a cell fails.
    """
    notebook = nbformat.read(path, as_version=4)
    # No kernels that are installed elsewhere: what is left is that of this Python.
    kernels = KernelSpecManager(kernel_dirs=[])
    client = NotebookClient(
        notebook,
        km=AsyncKernelManager(kernel_spec_manager=kernels),
        resources={"metadata": {"path": str(path.parent)}},
        timeout=600,
        coalesce_streams=True,
        record_timing=False,
    )
    return client.execute()


def shrink_pictures(notebook: NotebookNode) -> None:
    """Leave each picture 256 colours: the eye hardly sees it, and the file is a third as large."""
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            picture = output.get("data", {}).get("image/png")
            if picture is not None:
                image = Image.open(BytesIO(b64decode(picture))).convert("RGB")
                # Rare colours count as much as frequent ones: the ends of a ramp, a traffic light.
                few = image.quantize(256, method=Image.Quantize.MAXCOVERAGE, kmeans=3)
                stream = BytesIO()
                few.save(stream, "png", optimize=True)
                output["data"]["image/png"] = b64encode(stream.getvalue()).decode()


def main() -> None:
    notebook = run_cells(TUTORIAL)
    shrink_pictures(notebook)
    notebook.metadata["language_info"] = {"name": "python"}
    with write_atomically(TUTORIAL) as stream:
        stream.write((nbformat.writes(notebook) + "\n").encode())
    print(TUTORIAL)


if __name__ == "__main__":
    main()
