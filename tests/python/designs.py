"""Every design in the Python package, against the command line. `python designs.py`, with the program's path in
MESOPHYLL and the repository's root as the working folder.
"""

import json
import unittest
from pathlib import Path

from verbs import TABLES, Folder, columns, command

import mesophyll as mp


class Designs(Folder):
    """Designs are results like all others, with the command line's numbers."""

    def planned(self, words, found):
        told = json.loads(command("design", *words, "--json"))
        self.assertEqual(found.record, told)
        left_open = "; ".join(told["undetermined"])
        self.assertEqual(found.status, f"undetermined: {left_open}" if left_open else "ok")
        for k, name in enumerate(told["columns"]):
            self.assertEqual(list(found)[k], name)
            cells = [row[name] for row in told["chosen"]]
            self.assertEqual([c for c in found[name].tolist()], cells)
        json.dumps(found.to_dict(), allow_nan=False)

    def test_designs(self):
        elm = "data/leaves/elm.toml"
        found = mp.design.leaf(elm, frames=16, candidates=24, for_=["m"])
        self.planned(["leaf", elm, "--frames", "16", "--candidates", "24", "--for", "m"], found)
        self.assertEqual((found["pass"].dtype, found.position_mm.size), (object, 16))
        marks = mp.design.beam(400.0, 60.0, marks=5, load="tip")
        self.planned(["beam", "--length-mm", "400", "--tip-mm", "60", "--marks", "5", "--load", "tip"], marks)
        self.planned(["motion", "--length-mm", "600"], mp.design.motion(length_mm=600.0))
        self.same(["design", "slab", "--in", TABLES / "slab.csv"], mp.design.slab(columns(TABLES / "slab.csv")))

    def test_of_tables(self):
        samples = TABLES / "samples.csv"
        words = ["gloss", "--in", samples, "--values", "brf_550", "--directions", "6"]
        self.planned(words, mp.design.gloss(samples, values="brf_550", directions=6))
        with self.assertRaises(mp.Error) as caught:
            mp.design.foliar({"wavelength_nm": [450.0]})
        self.assertEqual(caught.exception.file, "<pigments>")

    def test_of_scenes(self):
        scene = Path("data/pictures/plan.toml")
        options = {"cameras": 1, "draws": 1, "samples": 8, "columns": 8, "more": 1}
        words = [f"--{name}={value}" for name, value in options.items()]
        found = mp.design.scene(scene, **options)
        self.planned(["scene", scene, *words], found)
        self.assertEqual((found.camera.size, found.sun_zenith_deg.tolist()), (1, [35.0]))


if __name__ == "__main__":
    unittest.main()
