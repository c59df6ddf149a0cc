"""Every verb of `fit` and `eval` in the Python package: against the command line, and against answers that are known
otherwise. `python verbs.py`, with the program's path in MESOPHYLL and the repository's root as the working folder.
"""

import csv
import json
import math
import os
import pickle
import re
import subprocess
import tempfile
import unittest
from pathlib import Path

import numpy as np

import mesophyll as mp

PROGRAM = os.environ["MESOPHYLL"]
TABLES = Path("data/tables")


def command(*words):
    """What a verb prints."""
    done = subprocess.run([PROGRAM, "--quiet", *map(str, words)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def columns(path):
    """The columns of a file as lists: numbers where all cells are."""
    with Path(path).open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))

    def numbers(cells):
        try:
            return [float(c) if c else math.nan for c in cells]
        except ValueError:
            return cells

    return {name: numbers([row[name] for row in rows]) for name in rows[0]}


class Folder(unittest.TestCase):
    def setUp(self):
        made = tempfile.TemporaryDirectory()
        self.addCleanup(made.cleanup)
        self.at = Path(made.name)

    def same(self, words, found):
        """The columns that the command line prints are the result's, digit by digit."""
        rows = list(csv.DictReader(command(*words).splitlines()))
        self.assertTrue(rows)
        self.assertEqual(list(rows[0]), list(found))
        for name, value in found.items():
            cells = [row[name] for row in rows]
            value = np.atleast_1d(np.asarray(value, dtype=object)).tolist()
            told = [("" if isinstance(v, float) and math.isnan(v) else v) for v in value]
            self.assertEqual([float(c) if isinstance(v, float) else c for c, v in zip(cells, told)], told, name)


class Complete(unittest.TestCase):
    """The page lists every verb of `fit`, `eval` and `design`, and every function that it lists is there."""

    def test_the_page_is_true(self):
        page = Path("docs/python.md").read_text(encoding="utf-8")
        rows = [line.split("|")[1:-1] for line in page.splitlines() if line.startswith("| `mp.")]
        listed = [name for row in rows for name in re.findall(r"`mp\.([A-Za-z_.]+)", " ".join(row[:2]))]
        for name in listed:
            thing = mp
            for part in name.split("."):
                thing = getattr(thing, part)
            self.assertTrue(callable(thing), name)
        offered = {f"{m}.{f}" for m in mp.__all__ if hasattr(getattr(mp, m), "__all__") for f in getattr(mp, m).__all__}
        self.assertEqual(offered, {name for name in listed if "." in name})
        verbs = {verb for row in rows for verb in re.findall(r"`((?:fit|eval|design) [a-z]+)", row[2])}
        for group, least in (("fit", 10), ("eval", 10), ("design", 7)):
            said = command(group, "--help").split("Commands:")[1].split("Options:")[0]
            names = set(re.findall(r"^  ([a-z]+) ", said, re.MULTILINE)) - {"help"}
            self.assertGreaterEqual(len(names), least)
            self.assertEqual({f"{group} {name}" for name in names}, {v for v in verbs if v.startswith(group)})


class Tables(Folder):
    """Tables in memory and in files."""

    def test_slabs(self):
        file = TABLES / "one-side.csv"
        words = ["fit", "slab", "--noise", "0.001", "--index", "1.41", "--in", file]
        found = mp.slab.fit(columns(file), noise=0.001, index=1.41)
        self.same(words, mp.slab.fit(file, noise=0.001, index=1.41))
        np.testing.assert_array_equal(found.sigma_a, mp.slab.fit(file, noise=0.001, index=1.41).sigma_a)
        self.assertEqual(list(found.params), ["sigma_a", "sigma_s"])
        self.assertTrue(any("index 1.41" in note for note in found.notes), found.notes)
        # What is known is carried through and no parameter; what is left open says why.
        dark = mp.slab.fit({"rho_d": [0.05, 0.1], "rho_t": [0.0, 0.15], "h": [0.15, 0.2]}, noise=0.005)
        self.assertEqual((list(dark.ok), dark.params["sigma_s"].unit), ([False, True], "1/mm"))
        self.assertEqual(dark.undetermined["sigma_a"].tolist(), ["sigma_a >= 23", ""])

    def test_pigments(self):
        spectra, pigments = TABLES / "foliar.csv", TABLES / "pigments.csv"
        words = ["fit", "foliar", "--pigments", pigments, "--noise", "0.002", "--in", spectra]
        self.same(words, mp.foliar.fit(spectra, pigments, noise=0.002))
        found = mp.foliar.fit(columns(spectra), columns(pigments), noise=0.002)
        self.assertEqual(list(found.status), list(mp.foliar.fit(spectra, pigments, noise=0.002).status))
        poplar = list(found.leaf).index("poplar")
        self.assertEqual(found.params["chlorophyll_ug_cm2"].undetermined[poplar], "")
        self.assertEqual(
            found.params["carotenoid_ug_cm2"].undetermined[poplar], "the measurement does not determine it"
        )
        self.assertEqual(found.params["chlorophyll_ug_cm2"].unit, "ug/cm^2")
        # The exact model gives readings, and the fit gives their pigments back.
        leaf = {"incidence_deg": 8.0, "side": "adaxial", "mesophyll_thickness_mm": 0.2, "path": "sieve"}
        leaf |= {"chlorophyll_ug_cm2": 30.0, "carotenoid_ug_cm2": 9.0, "protein_ug_cm2": 0.0}
        leaf |= {"cellulose_lignin_ug_cm2": 0.0, "water_g_cm2": 0.0, "wavelength_nm": [450.0, 550.0, 650.0]}
        seen = mp.foliar.abm(leaf, pigments=pigments, method="exact")
        both = {"R": seen.reflectance, "T": seen.transmittance}
        one = {f"{q}{w}": shares[k] for q, shares in both.items() for k, w in enumerate((450, 550, 650))}
        back = mp.foliar.fit(one, pigments, noise=0.001)
        self.assertEqual((back.status, type(back.chlorophyll_ug_cm2)), ("ok", float))
        self.assertAlmostEqual(back.chlorophyll_ug_cm2 / 30.0, 1.0, delta=0.01)

    def test_coefficients(self):
        # Made-up leaves of six species: bands of absorption in a slab, and what its surface reflects.
        wavelengths = np.arange(400.0, 2500.0, 60.0)
        random = np.random.default_rng(3)
        contents = random.uniform([20, 4, 0.005, 0.003], [80, 18, 0.02, 0.01], (24, 4))
        bands = {0: [(440, 50, 0.3), (670, 30, 0.2)], 1: [(480, 30, 0.4)], 2: [(1450, 80, 300), (1940, 90, 900)]}
        bands[3] = [(1700, 150, 150), (2200, 150, 400)]
        table = {"species": [f"kind {k % 6}" for k in range(24)]}
        names = ["chlorophyll_ug_cm2", "carotenoid_ug_cm2", "water_g_cm2", "dry_g_cm2"]
        table |= {f"measured_{name}": contents[:, k] for k, name in enumerate(names)}
        for w in wavelengths:
            depth = sum(c * contents[:, k] * np.exp(-0.5 * ((w - at) / s) ** 2) for k in bands for at, s, c in bands[k])
            R, T = mp.slab.forward(0.05 + depth, 12.0, 0.2)
            table |= {f"R{w:.0f}": np.round(R + 0.04, 4), f"T{w:.0f}": np.round(T, 4)}
        out = self.at / "coefficients.csv"
        made = mp.foliar.coefficients(table, out)
        self.assertEqual(
            (made.wavelength_nm.tolist(), made.params["water_per_cm"].unit), (wavelengths.tolist(), "1/cm")
        )
        self.assertEqual((made.record["leaves"], made.record["species"]), (24, 6))
        # The file is the command line's, byte by byte, and so are the contents that it finds.
        file, again = self.at / "leaves.csv", self.at / "again.csv"
        cells = [list(map(str, np.asarray(v).tolist())) for v in table.values()]
        file.write_text("\n".join([",".join(table), *map(",".join, zip(*cells))]) + "\n", encoding="utf-8")
        command("fit", "coefficients", "--in", file, "-o", again)
        self.assertEqual(again.read_bytes(), out.read_bytes())
        found = mp.foliar.fit(table, out, noise=0.003)
        self.same(["fit", "foliar", "--pigments", again, "--noise", "0.003", "--in", file], found)
        self.assertEqual(list(found.params), names)

    def test_other_tables(self):
        bands = mp.spectra.bands(columns(TABLES / "bands.csv"), noise=0.002)
        self.same(["eval", "bands", "--noise", "0.002", "--in", TABLES / "bands.csv"], bands)
        sun = columns(TABLES / "sun.csv")
        names = ["latitude_deg", "hour", "declination_deg"]
        place = mp.sky.sun(*(sun[name] for name in names[:2]), declination_deg=sun[names[2]])
        rows = ["eval", "sun", "--in", self.at / "sun.csv"]
        lines = [",".join(names), *(",".join(map(str, row)) for row in zip(*(sun[name] for name in names)))]
        (self.at / "sun.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
        self.same(rows, place)
        self.same(["eval", "fsm", "--in", TABLES / "fsm.csv"], mp.foliar.fsm(TABLES / "fsm.csv"))
        self.same(
            ["fit", "beam", "--in", TABLES / "tapers.csv"],
            mp.branch.coefficients(columns(TABLES / "tapers.csv")["alpha"]),
        )

    def test_branches(self):
        file, out = Path("data/branches/elm-twig.csv"), self.at / "twig"
        found = mp.branch.fit(columns(file), load="even", positions="axis", out=out)
        self.same(["fit", "beam", "--deflections", file, "--load", "even", "--positions", "axis"], found)
        self.assertIn("load_n and modulus_gpa", found.params["root_radius_mm"].undetermined[0])
        kept = mp.fits.read(out)
        self.assertEqual(kept.parts["branch elm-twig"].tip, found.tip_mm[0])
        self.assertIn("load_n", kept.undetermined["branch elm-twig.root_radius"])
        # A branch of 2 Hz that was pulled and let go.
        t = np.arange(0.0, 8.0, 1 / 60)
        u = 20 * np.exp(-0.25 * t) * np.cos(2 * math.pi * 2.0 * t) + np.random.default_rng(1).normal(0, 0.05, t.size)
        free = mp.branch.motion({"time_s": t, "u_mm": u}, noise=0.05)
        self.assertEqual((free.status, free.kind, free.params["resonance_hz"].unit), ("ok", "free-decay", "Hz"))
        self.assertLess(abs(free.damping_per_s - 0.5), 4 * free.damping_per_s_err)
        self.assertTrue(free.params["damping_per_s"].determined)
        self.assertEqual(free.params["gain_v_mm_per_sqrt_hz"].undetermined, "there is no value")
        sway = mp.branch.motion(Path("data/branches/elm-twig-sway.csv"))
        self.same(["fit", "motion", "--in", "data/branches/elm-twig-sway.csv"], sway)

    def test_gloss(self):
        device = TABLES / "device.toml"
        made = mp.gloss.evaluate([0.1, 0.2], 0.05, 0.2, [0.1, 0.0], device=device)
        self.assertEqual(made.traces.shape, (2, mp.gloss.frames(device).size))
        found = mp.gloss.fit(made.traces, device)
        np.testing.assert_allclose(found.rho_d, [0.1, 0.2], rtol=1e-3)
        self.assertEqual(mp.gloss.evaluate(0.1, 0.05, 0.2, device=device).traces.ndim, 1)
        noisy = mp.gloss.evaluate([0.1, 0.1], 0.05, 0.2, device=device, noise=0.02).traces
        self.assertFalse((noisy[0] == noisy[1]).any())


BALLS = "data/canopies/balls.toml"


class Scenes(Folder):
    def leaf(self, **more):
        """A scene of one wide plate over ground, which repeats: a canopy whose answer has a closed form."""
        (self.at / "disc.txt").write_text("3 0.2 0.1 2 0 0 1\n", encoding="utf-8")
        (self.at / "at.txt").write_text("0 0 0\n", encoding="utf-8")
        text = 'schema = 1\nname = "plate"\n[ground]\nalbedo = [0.3, 0.2, 0.1]\n[periodic]\nsize_mm = [1000, 1000]\n'
        text += "[sun]\nzenith_deg = 40\nradius_deg = 0\nirradiance = [1, 1, 1]\n"
        text += '[[leaf]]\nname = "plate"\ndiscs = "disc.txt"\n'
        text += "uniform = { rho_d = [[0.4, 0.4, 0.4], [0.4, 0.4, 0.4]], rho_t = [0.35, 0.35, 0.35] }\n"
        text += '[[instance]]\nleaf = "plate"\npositions = "at.txt"\n'
        text += '[[view]]\nname = "down"\nkind = "perspective"\neye_mm = [0, 0, 3000]\ntarget_mm = [0, 0, 0]\n'
        text += "up = [0, 1, 0]\nfov_deg = 10\n[check]\nwidth = 8\nheight = 6\n"
        for name, part in more.items():
            text += part
            self.assertTrue(name)
        place = self.at / "scene.toml"
        place.write_text(text, encoding="utf-8")
        return place

    def test_canopies(self):
        scene = self.leaf()
        rho, tau, ground = 0.4, 0.35, np.array([0.3, 0.2])
        # Between plate and ground: down D = tau + rho U, up U = ground D.
        reflected = rho + tau * ground * tau / (1 - rho * ground)
        for channel, true in zip("RG", reflected):
            seen = mp.scene.canopy(scene, [0.0, 55.0, -70.0], [0.0, 130.0, 10.0], channel=channel, samples=20_000)
            self.assertTrue((np.abs(seen.brf - true) < 4 * seen.brf_err + 1e-12).all(), f"{seen.brf} {true}")
        flux = mp.scene.fluxes(scene, channel="R", samples=20_000)
        self.assertLess(abs(flux.reflected - reflected[0]), 4 * flux.reflected_err + 1e-12)
        self.assertEqual(list(flux.params), ["reflected", "absorbed", "transmitted"])
        # The same by spectra.
        (self.at / "leaf.csv").write_text("wavelength_nm,R,T\n500,0.4,0.35\n800,0.5,0.45\n", encoding="utf-8")
        (self.at / "soil.csv").write_text("wavelength_nm,albedo\n500,0.3\n800,0.4\n", encoding="utf-8")
        text = scene.read_text("utf-8").replace("albedo = [0.3, 0.2, 0.1]", 'spectrum = "soil.csv"')
        head, tail = text.split("uniform = {")
        scene.write_text(f'{head}uniform = {{ spectrum = "leaf.csv" }}{tail.split("}", 1)[1]}', encoding="utf-8")
        flux = mp.scene.fluxes(scene, bands=[500, 800], samples=20_000)
        self.assertEqual((list(flux.wavelength_nm), list(flux.params)[::2]), ([500, 800], ["reflected", "transmitted"]))
        rho, tau, ground = np.array([[0.4, 0.5], [0.35, 0.45], [0.3, 0.4]])
        down = tau / (1 - rho * ground)
        off = np.stack([flux.reflected - rho - tau * ground * down, flux.transmitted - down])
        self.assertTrue((np.abs(off) < 4 * np.stack([flux.reflected_err, flux.transmitted_err])).all(), f"{off}")
        with self.assertRaises(mp.Error) as caught:
            mp.scene.canopy(self.leaf(), 95.0)
            mp.scene.canopy("data/scenes/front-lit.toml", 0.0)
        self.assertEqual(
            (caught.exception.file, "periodic" in str(caught.exception)), ("data/scenes/front-lit.toml", True)
        )

    def test_pictures(self):
        scene = self.leaf()
        drawn = mp.scene.render(scene, self.at / "drawn", samples=64)
        self.assertEqual((list(drawn.view), list(drawn.status)), (["down"], ["ok"]))
        picture, ground = drawn.maps("down"), np.array([0.3, 0.2, 0.1])
        true = 0.4 + 0.35**2 * ground / (1 - 0.4 * ground)
        # Radiance is irradiance on the level ground, times the reflectance, over pi.
        for channel, r in zip("RGB", true):
            mean = picture[channel].mean()
            self.assertAlmostEqual(mean / (r * math.cos(math.radians(40)) / math.pi), 1.0, delta=0.03)
        told = mp.command("render", scene, "-o", self.at / "told", "--samples", "64", "--json")
        self.assertEqual(told.record[0]["view"], "down")
        np.testing.assert_array_equal(mp.fits.read_exr(self.at / "told/down.exr")["G"], picture["G"])
        plan = mp.scene.plan(scene)
        self.assertIsInstance(plan.record, dict)
        # The ground is found from the picture of it.
        unknown = '[[picture]]\nview = "down"\nfile = "drawn/down.exr"\nnoise = 0.01\n'
        unknown += '[unknown]\nleaves = { plate = ["rho_d"] }\n'
        start = self.leaf(unknown=unknown)
        start.write_text(start.read_text().replace("0.4, 0.4, 0.4", "0.2, 0.2, 0.2"), encoding="utf-8")
        found = mp.scene.fit(start, self.at / "found", samples=64)
        for channel in "RGB":
            leaf = found.params[f"leaf.plate.rho_d.{channel}"]
            self.assertTrue(abs(leaf.value - 0.4) < 0.02 and 0 < leaf.stderr < 0.01 and leaf.determined, leaf)

    def test_checks(self):
        text = Path("data/scenes/front-lit.toml").read_text(encoding="utf-8").replace("../..", os.getcwd())
        text = text.replace("../leaves", f"{os.getcwd()}/data/leaves").replace("flip_p99 = 0.061", "flip_p99 = 0.9")
        text = text.replace("max_error = 0.031", "max_error = 0.9")
        text = text.replace("width = 800\nheight = 600", "width = 40\nheight = 30")
        scene = self.at / "leaf.toml"
        scene.write_text(text, encoding="utf-8")
        try:
            good = mp.scene.check(scene, self.at / "checked")
        except mp.Error as e:
            if os.environ.get("MESOPHYLL_REQUIRE_ALL") or "adapter" not in str(e):
                raise
            self.skipTest(str(e))
        self.assertEqual((good.status, good.record["passed"]), ("ok", True))
        scene.write_text(text.replace("max_error = 1e-3", "max_error = 1e-9"), encoding="utf-8")
        bad = mp.scene.check(scene, self.at / "checked")
        self.assertTrue(bad.status.startswith("missed") and bad.record["passed"] is False, bad.status)

    def test_sway(self):
        scene = "data/scenes/twig.toml"
        sway = mp.scene.sway(scene, 0.5, step=0.25)
        del sway["status"]
        self.same(["eval", "sway", scene, "--to", "0.5", "--step", "0.25"], sway)
        self.assertEqual(sway.time_s.tolist(), [0.0, 0.25, 0.5])


class Folders(Folder):
    """Fits that leave a folder are results like all others."""

    def test_leaves(self):
        scan = mp.leaf.synth("data/leaves/elm.toml", self.at / "scan", size="24x18", frames=12)
        self.assertTrue(mp.leaf.inspect(scan.folder).ok)
        fit = mp.leaf.fit(scan.folder, self.at / "elm")
        self.assertEqual(fit.status, mp.fits.read(self.at / "elm").status)
        self.assertEqual(fit.front.sigma_a.tolist(), fit.record["front"]["sigma_a"]["value"])
        self.assertEqual(fit.record["kind"], "leaf")
        through = mp.translucency.fit(self.at / "elm", self.at / "through", levels=3, lights=16)
        self.assertIn("front", through.record)
        self.assertTrue((self.at / "through/fit.toml").exists() and through.maps("front"))
        told = mp.fits.report(self.at / "elm")
        self.assertEqual((told.record["fits"][0]["kind"], told.status[:8]), ("leaf", fit.status[:8]))
        beams = mp.leaf.synth("data/leaves/elm.toml", self.at / "beams", size="24x18", acquisition="beams")
        tissue = mp.translucency.tissue(beams.folder, self.at / "elm", self.at / "tissue", levels=3)
        self.assertTrue(tissue.params and all(p.unit or p.name for p in tissue.params.values()))

    def test_skies(self):
        fit = mp.sky.fit(self.at / "sky", bands=2, method="compact")
        self.assertEqual((fit.record["kind"], fit.status.split(":")[0] in ("ok", "doubtful")), ("sky", True))
        sky = mp.sky.panorama(self.at / "sky.exr", 50.0, 3.0, sun_azimuth_deg=20.0, noise=0.02, size="64x32", seed=3)
        self.assertEqual(sky["G"].shape, (32, 64))
        found = mp.sky.fit_panorama(self.at / "sky.exr", self.at / "found")
        for name, true in (("turbidity", 3.0),):
            self.assertLess(abs(found[name] - true), 4 * found[f"{name}_err"])

    def test_grass(self):
        fit = mp.grass.fit("data/grass/short.toml", self.at / "lawn", slices=2, texels=(8, 4), rays=1, entries=4)
        self.assertEqual(fit.record["kind"], "grass")
        self.assertTrue(fit.maps("slices"))


class OneKind(Folder):
    """Results and errors are of one kind."""

    def test_results(self):
        some = [
            mp.slab.invert([0.2, 0.05], [0.2, 0.0], 0.2, 0.001),
            mp.slab.invert(0.2, 0.2, 0.2, 0.001),
            mp.slab.fit({"rho_d": 0.2, "rho_t": [0.2], "h": 0.2}),
            mp.foliar.evaluate(3.0, 0.2, 1.5, 1.4, 1.35, method="exact"),
            mp.fits.read("fits/elm"),
            mp.fits.read("fits/elm-twig"),
            mp.leaf.inspect(mp.leaf.synth("data/leaves/elm.toml", self.at / "scan", size="24x18", frames=12).folder),
        ]
        for found in some:
            self.assertIsInstance(found, mp.Result)
            told = json.loads(json.dumps(found.to_dict(), allow_nan=False))
            self.assertEqual(set(told), {"status", "params", "values", "undetermined", "notes", "folder"})
            for name, param in found.params.items():
                self.assertEqual((param.name, np.shape(param.value)), (name, np.shape(param.stderr)))
                self.assertEqual(set(told["params"][name]), {"value", "stderr", "unit", "undetermined"})
            again = pickle.loads(pickle.dumps(found))
            self.assertEqual((repr(again), again.notes), (repr(found), found.notes))
        elm = mp.fits.read("fits/elm")
        self.assertEqual((elm.params["front.sigma_a"].unit, elm.ok), ("1/mm", True))
        np.testing.assert_array_equal(elm["front.sigma_a"], elm.front.sigma_a)
        # A thickness that the fit takes from the caliper has an error that nobody stated: null.
        self.assertIsNone(elm.to_dict()["params"]["front.thickness"]["stderr"])

    def test_errors(self):
        spectra, pigments, scene = TABLES / "foliar.csv", TABLES / "pigments.csv", "data/scenes/front-lit.toml"

        def raised(call):
            with self.assertRaises(mp.Error) as caught:
                call()
            self.assertEqual(str(caught.exception).count("\n"), 0)
            return caught.exception

        for kind, said, call in (
            (ValueError, "noise", lambda: mp.slab.fit(TABLES / "slab.csv", noise=-1.0)),
            (OSError, "nowhere.csv", lambda: mp.slab.fit("nowhere.csv")),
            (FileNotFoundError, "nowhere", lambda: mp.scene.fit("nowhere.toml", self.at / "out")),
            (ValueError, "<table>: rho_t: no such column", lambda: mp.slab.fit({"rho_d": [0.1], "h": [0.2]})),
            (ValueError, "unexpected argument 'tuning'", lambda: mp.foliar.fit(spectra, pigments, tuning=3)),
            (ValueError, "one length", lambda: mp.slab.fit({"rho_d": [0.1, 0.2], "h": [0.2, 0.1, 0.3]})),
            (ValueError, "columns by name", lambda: mp.slab.fit(3)),
            (ValueError, "unrecognized subcommand 'fti'", lambda: mp.command("fti", "slab")),
            (ValueError, "the threads are those", lambda: mp.command("--threads", "2", "fit", "slab")),
            (ValueError, "a window is opened by the command line", lambda: mp.command("view", scene)),
            (ValueError, "<pigments>", lambda: mp.foliar.fit(spectra, {"wavelength_nm": [450.0]})),
        ):
            error = raised(call)
            self.assertIsInstance(error, kind)
            self.assertIn(said, str(error))
        broken = self.at / "scene.toml"
        broken.write_text("schema = 1\nname = 3\n", encoding="utf-8")
        error = raised(lambda: mp.scene.plan(broken))
        self.assertEqual((error.file, error.line), (str(broken), "2"))
        self.assertEqual(raised(lambda: mp.slab.fit({"rho_d": [0.1], "h": [0.2]})).file, "<table>")
        # A table of which every row is refused is answered all the same.
        self.assertTrue(mp.slab.fit({"rho_d": [2.0], "rho_t": [0.1], "h": [0.2]}).status[0].startswith("refused"))


if __name__ == "__main__":
    unittest.main()
