"""Runs the code cells of a notebook in order, in the notebook's folder: `python notebook.py NOTEBOOK.ipynb`.

Pictures are drawn and not shown. Every picture has to show something: a figure without data fails.
"""

import json
import os
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

notebook = Path(sys.argv[1]).resolve()
cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
os.chdir(notebook.parent)
names = {"__name__": "__main__"}
ran = 0
for number, cell in enumerate(cells):
    if cell["cell_type"] != "code":
        continue
    exec(compile("".join(cell["source"]), f"{notebook.name}, cell {number}", "exec"), names)
    ran += 1
figures = [plt.figure(k) for k in plt.get_fignums()]
assert figures, "the notebook draws nothing"
for figure in figures:
    assert all(axes.has_data() for axes in figure.axes), "a picture is empty"
    if len(sys.argv) > 2:
        figure.savefig(Path(sys.argv[2]) / f"{notebook.stem}-{figure.number}.png", dpi=70)
print(f"{notebook.name}: {ran} cells, {len(figures)} pictures")
