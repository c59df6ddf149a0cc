"""The Python package against the command line, and how it says no: `python package.py`, with the program's path in
MESOPHYLL and the repository's root as the working folder.
"""

import csv
import inspect
import io
import os
import signal
import subprocess
import tempfile
import threading
import time
import tomllib
import unittest
import warnings
from pathlib import Path

import numpy as np

import mesophyll as mp

PROGRAM = os.environ["MESOPHYLL"]
# A script's background jobs start with Ctrl-C ignored, and Python then leaves it so.
signal.signal(signal.SIGINT, signal.default_int_handler)
TABLES = Path("data/tables")


def command(*words, text=None):
    """The rows that a verb prints, a dictionary each."""
    done = subprocess.run([PROGRAM, "--quiet", *words], input=text, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return list(csv.DictReader(io.StringIO(done.stdout)))


def table(**columns):
    lines = [",".join(columns)]
    lines += [",".join(v if isinstance(v, str) else repr(float(v)) for v in row) for row in zip(*columns.values())]
    return "\n".join(lines) + "\n"


def cells(rows, name):
    return np.array([float(row[name]) if row[name] else np.nan for row in rows])


class Same(unittest.TestCase):
    """The numbers are the command line's, digit by digit."""

    def same(self, rows, result, names):
        self.assertTrue(rows)
        for name in names:
            np.testing.assert_array_equal(np.asarray(result[name]).reshape(-1), cells(rows, name), name)
        if "status" in result:
            self.assertEqual([row["status"] for row in rows], list(np.asarray(result["status"]).reshape(-1)))

    def test_slabs_are_inverted(self):
        random = np.random.default_rng(5)
        # More rows than are computed on one thread, some of them impossible.
        r, t = random.uniform(-0.01, 0.6, 2000), random.uniform(-0.01, 0.6, 2000)
        h = random.uniform(0.05, 0.5, 2000)
        names = ["sigma_a", "sigma_s", "sigma_a_err", "sigma_s_err"]
        text = table(rho_d=r, rho_t=t, h=h)
        found = mp.slab.invert(r, t, h, 0.002)
        self.same(command("fit", "slab", "--noise", "0.002", text=text), found, names)
        self.assertTrue(found.ok.any() and any(s.startswith("refused") for s in found.status))
        self.assertTrue(any(s.startswith("undetermined") for s in found.status))
        self.same(command("fit", "slab", "--surface", "0.03", text=text), mp.slab.invert(r, t, h, surface=0.03), names)
        exact = mp.slab.invert(r[:50], t[:50], h[:50], 0.001, method="exact")
        text = table(rho_d=r[:50], rho_t=t[:50], h=h[:50])
        self.same(command("fit", "slab", "--noise", "0.001", "--method", "exact", text=text), exact, names)

    def test_slabs_are_evaluated(self):
        omega, delta = np.array([0.0, 0.5, 0.99, 1.0, 1.2]), np.array([1.0, 3.0, 10.0, 0.1, 1.0])
        for method in ("fast", "exact", "fn"):
            rows = command("eval", "slab", "--method", method, text=table(omega=omega, delta=delta))
            self.same(rows, mp.slab.evaluate(omega, delta, method=method), ["rho_d", "rho_t"])
        # The same slab by its coefficients.
        R, T = mp.slab.forward(1.0, 9.0, 0.3)
        seen = mp.slab.evaluate(0.9, 3.0)
        self.assertAlmostEqual(R, seen.rho_d, places=12)
        self.assertAlmostEqual(T, seen.rho_t, places=12)

    def test_traces(self):
        device = TABLES / "device.toml"
        rows = command("fit", "gloss", "--geometry", str(device), "--in", str(TABLES / "traces.csv"))
        with (TABLES / "traces.csv").open() as file:
            traces = [[float(v) for k, v in row.items() if k.startswith("r")] for row in csv.DictReader(file)]
        names = [name + error for name in ("rho_d", "rho_s", "m", "tilt") for error in ("", "_err")]
        found = mp.gloss.fit(traces, device)
        self.same(rows, found, [*names, "chi2"])
        # Colour: three equal channels have the one's reflectance; each descent ends a little before the minimum.
        colour = mp.gloss.fit(np.repeat(np.array(traces)[..., np.newaxis], 3, axis=-1), device)
        self.assertEqual(colour.rho_d.shape, (len(traces), 3))
        np.testing.assert_allclose(colour.rho_d[:, 1], found.rho_d, rtol=1e-4)

    def test_samples(self):
        rows = command("fit", "gloss", "--samples", "--lobe", "ggx", "--in", str(TABLES / "samples.csv"))
        with (TABLES / "samples.csv").open() as file:
            samples = [row for row in csv.DictReader(file) if row["leaf"] == rows[0]["leaf"]]
        bands = [name for name in samples[0] if name.startswith("brf")]
        angles = [[float(s[a]) for s in samples] for a in ("source_zenith_deg", "view_zenith_deg", "view_azimuth_deg")]
        values = [[float(s[b]) for b in bands] for s in samples]
        found = mp.gloss.fit_samples(*angles, values, names=bands, lobe="ggx")
        for k, band in enumerate(bands):
            self.assertEqual(found.rho_d[k], float(rows[0][f"rho_d_{band}"]))
        self.same(rows[:1], found, ["rho_s", "m", "tilt", "tilt_y", "rms", "rho_s_err", "m_err", "tilt_err"])

    def test_sky(self):
        sun, haze = np.array([0.3, 1.2]), np.array([3.0, 7.5])
        ways = [{}, {"bands": 3, "window": "lanczos", "ground": 0.3}, {"method": "direct", "bands": 4}]
        ways.append({"method": "direct", "model": "hosek-wilkie", "bands": 2, "albedo": 0.4})
        for way in ways:
            words = [word for name, value in way.items() for word in (f"--{name}", str(value))]
            rows = command("eval", "sky", *words, text=table(sun_zenith=sun, turbidity=haze))
            found = mp.sky.coefficients(sun, haze, **way)
            np.testing.assert_array_equal(found.reshape(-1), np.stack([cells(rows, c) for c in "rgb"], -1).reshape(-1))

    def test_models(self):
        alpha, x = np.array([0.3, 1.0, 0.5]), np.array([1.0, 0.5, 0.0])
        rows = command("eval", "beam", text=table(alpha=alpha, x=x))
        u, du = mp.branch.evaluate(alpha, x)
        np.testing.assert_array_equal(u, cells(rows, "u"))
        np.testing.assert_array_equal(du, cells(rows, "du"))
        d, r = np.array([0.2, 0.5, 0.01, -1.0]), np.array([0.0, 0.3, 0.1, 0.1])
        for method in ("dipoles", "images", "thin"):
            rows = command("eval", "dipole", "--method", method, text=table(thickness=d, radius=r))
            self.same(rows, mp.translucency.dipole(d, r, method=method), ["t"])
        leaf = dict(absorption_per_mm=[3.0, 0.1], mesophyll_thickness_mm=[0.2, 0.3])
        leaf |= dict(n_cuticle=[1.5, 1.6], n_mesophyll=[1.4, 1.41], n_antidermal=[1.35, 1.42])
        text = table(incidence_deg=[8, 30], side=["adaxial"] * 2, **leaf)
        for words in (["--method", "exact"], ["--rays", "2000", "--seed", "7"]):
            way = {w.removeprefix("--"): v if w == "--method" else int(v) for w, v in zip(words[::2], words[1::2])}
            found = mp.foliar.evaluate(*leaf.values(), [8, 30], **way)
            self.same(command("eval", "abm", *words, text=text), found, [n for n in found if n != "status"])

    def test_leaf(self):
        with tempfile.TemporaryDirectory() as folder:
            scan, out = f"{folder}/scan", f"{folder}/elm"
            command("synth", "data/leaves/elm.toml", "-o", scan, "--size", "24x18", "--frames", "12")
            command("fit", "leaf", scan, "-o", out)
            told, made = mp.fits.read(out), mp.leaf.fit(scan, f"{folder}/again")
            # As text: what is not known is NaN, which equals nothing.
            self.assertEqual(repr(told.record), repr(made.record))
            self.assertEqual((told.front.sigma_a.shape, told.params["front.sigma_a"].unit), ((3,), "1/mm"))
            # The same scan as arrays, front only.
            arrays = self.arrays(Path(scan))
            found = mp.leaf.fit(arrays, f"{folder}/arrays")
            maps, of_arrays = told.maps(), found.maps()
            good = (maps["mask.Y"] == 1) & (of_arrays["mask.Y"] == 1)
            self.assertGreater(good.sum(), 50)
            for name in ("rho_d.G", "rho_s.R", "m.Y", "rho_t.B"):
                np.testing.assert_allclose(of_arrays[name][good], maps[name][good], rtol=1e-5)
            self.assertEqual(maps["rho_d.R"].shape, (18, 24))
            # What was changed by hand is noticed.
            record = Path(out) / "fit.toml"
            record.write_text(record.read_text().replace('kind = "leaf"', 'kind = "leaf" '))
            with self.assertRaises(RuntimeError):
                mp.fits.read(out)

    def arrays(self, scan):
        told = tomllib.loads((scan / "capture.toml").read_text())

        def image(path):
            maps = mp.fits.read_exr(path)
            return maps["Y"] if "Y" in maps else np.stack([maps[c] for c in "RGB"], axis=-1)

        def images(folder):
            return np.stack([image(path) for path in sorted(folder.glob("*.exr"))])

        places = {p["name"]: np.linspace(p["start_mm"], p["end_mm"], p["frames"]) for p in told["pass"]}
        names = ["texel_mm", "thickness_mm", "camera_deg", "thickness_err_mm", "noise_relative", "noise_floor", "tube"]
        same = {name: told.get(name) for name in names}
        return mp.leaf.Capture(
            frames_x=images(scan / "front/x"),
            positions_x=places["x"],
            frames_y=images(scan / "front/y"),
            positions_y=places["y"],
            white_x=images(scan / "white/x"),
            white_y=images(scan / "white/y"),
            lightbox=image(scan / "front/lightbox.exr"),
            lightbox_empty=image(scan / "lightbox_empty.exr"),
            dark=image(scan / "dark.exr"),
            mask=image(scan / "mask.exr"),
            **same,
        )


class Says(unittest.TestCase):
    """Errors are those that a user of NumPy and SciPy expects, and name what is wrong."""

    def raises(self, kind, words, call, *arguments, **named):
        with self.assertRaises(kind) as caught:
            call(*arguments, **named)
        for word in words:
            self.assertIn(word, str(caught.exception))

    def test_values(self):
        self.raises(ValueError, ["broadcast", "R (2,)", "T (3,)"], mp.slab.invert, [0.1, 0.2], [0.1, 0.2, 0.3], 0.1)
        self.raises(ValueError, ["R", "numbers"], mp.slab.invert, "leaf", 0.1, 0.1)
        quick = ["method", '"quick"', "fast, exact"]
        self.raises(ValueError, quick, mp.slab.invert, 0.1, 0.1, 0.1, method="quick")
        self.raises(ValueError, ["noise"], mp.slab.invert, 0.1, 0.1, 0.1, -1)
        self.raises(ValueError, ["sigma_a is -1", "element (1,)"], mp.slab.forward, [1, -1], 1, 1)
        self.raises(ValueError, ["alpha is 2"], mp.branch.evaluate, 2.0, 0.5)
        self.raises(ValueError, ["sun"], mp.sky.coefficients, 3.0, 3.0)
        for bands in (0, 100_000):
            self.raises(ValueError, [f"bands is {bands}"], mp.sky.coefficients, 1.0, 3.0, bands)
        self.raises(ValueError, ["(4, 2)"], mp.sky.evaluate, np.zeros((4, 2)), [0, 0, 1])
        self.raises(ValueError, ["(2, 5)", "16"], mp.gloss.fit, np.zeros((2, 5)), TABLES / "device.toml")
        self.raises(ValueError, ["<device>", "height_mm"], mp.gloss.fit, np.zeros(5), {"height": 3})
        self.raises(ValueError, ["sigma_a"], mp.translucency.dipole, 0.1, 0.1, -3)
        self.raises(OSError, ["nowhere"], mp.leaf.fit, "nowhere", "nowhere-fit")
        self.raises(OSError, ["nowhere"], mp.fits.read, "nowhere")
        self.raises(OSError, ["nowhere.exr"], mp.fits.read_exr, "nowhere.exr")
        self.raises(ValueError, ["device.toml"], mp.fits.read_exr, TABLES / "device.toml")
        self.assertFalse(Path("nowhere-fit").exists())

    def test_arguments_have_the_names_of_arguments(self):
        for words, way in (
            ("ground is 2", {"ground": 2.0}),
            ("albedo is 3", {"albedo": 3.0}),
            ("model hosek-wilkie needs method direct", {"model": "hosek-wilkie"}),
            ("bands 20 with method compact", {"bands": 20, "method": "compact"}),
        ):
            with self.assertRaises(ValueError) as caught:
                mp.sky.coefficients(1.0, 3.0, **way)
            self.assertTrue(str(caught.exception).startswith(words), str(caught.exception))

    def test_warnings(self):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            mp.sky.coefficients(1.0, 3.0)
            mp.sky.coefficients(1.0, 3.0, method="direct", bands=2)
        with self.assertWarnsRegex(UserWarning, "fit covers.*: 2"):
            mp.sky.coefficients(1.0, [3.0, 7.0, 8.0], 3)
        with self.assertWarnsRegex(UserWarning, "trusted: 1"):
            mp.sky.coefficients(1.0, [1.8, 3.0], 3)

    def test_captures(self):
        image = np.ones((2, 2, 3))
        tube = {"height_mm": 100.0, "length_mm": 500.0, "radius_mm": 5.0}

        def scan(**other):
            told = dict(frames_x=[image], positions_x=[0.0], texel_mm=0.1, thickness_mm=0.2, camera_deg=0.0, tube=tube)
            return mp.leaf.Capture(**told | dict(lightbox=image, lightbox_empty=image) | other)

        with tempfile.TemporaryDirectory() as folder:
            for words, other in (
                ("thickness_mm is nan", {"thickness_mm": np.nan}),
                ("noise_floor is inf", {"noise_floor": np.inf}),
                ("tube: height_mm is nan", {"tube": tube | {"height_mm": np.nan}}),
                ("positions_x[0] is nan", {"positions_x": [np.nan]}),
            ):
                self.raises(ValueError, [words], scan(**other).write, f"{folder}/bad")
            self.assertFalse(Path(f"{folder}/bad").exists())
            name = "\N{MAPLE LEAF}\N{DECIDUOUS TREE} Ahorn"
            text = (scan(name=name).write(f"{folder}/scan") / "capture.toml").read_text(encoding="utf-8")
            self.assertEqual(tomllib.loads(text)["name"], name)

    def test_shapes(self):
        found = mp.slab.invert(np.full((3, 1), 0.2), np.full((1, 4), 0.2), 0.2, 0.001)
        self.assertEqual((found.sigma_a.shape, found.status.shape, found.ok.shape), ((3, 4),) * 3)
        one = mp.slab.invert(0.2, 0.2, 0.2, 0.001)
        self.assertEqual((type(one.sigma_a), one.status, one.ok), (float, "ok", True))
        self.assertEqual(mp.slab.invert([], [], 0.2).sigma_a.shape, (0,))
        self.assertEqual(mp.sky.coefficients([[1.0]], 3.0, 2).shape, (1, 1, 4, 3))
        # Whatever lies in memory: views, single precision, integers, lists.
        wide = np.linspace(0.1, 0.3, 10, dtype=np.float32)
        R, T = mp.slab.forward(wide[::2], [1] * 5, 1)
        np.testing.assert_array_equal(R, mp.slab.forward(wide[::2].astype(float).copy(), 1.0, 1.0)[0])

    def test_help(self):
        modules = [m for m in (getattr(mp, name) for name in mp.__all__) if inspect.ismodule(m)]
        self.assertEqual(len(modules), 12)
        for function in [getattr(m, name) for m in modules for name in m.__all__] + [mp.command]:
            words = function.__doc__
            self.assertTrue(words and len(words) > 60, function)
            if inspect.isfunction(function):
                for name, parameter in inspect.signature(function).parameters.items():
                    self.assertIn(name, words, function.__name__)
                    self.assertNotEqual(parameter.annotation, inspect.Parameter.empty, function.__name__)

    def test_xarray(self):
        try:
            import xarray  # noqa: F401
        except ImportError:
            self.skipTest("xarray is not installed")
        self.assertEqual(mp.slab.invert([0.2], 0.2, 0.2).to_xarray(["leaf"]).sizes, {"leaf": 1})


class Stops(unittest.TestCase):
    """Ctrl-C ends a call at once, and no other one."""

    def interrupted(self, call, after=0.3):
        """How long a call went on after Ctrl-C."""
        pressed, over = [], []

        def press():
            pressed.append(time.monotonic())
            os.kill(os.getpid(), signal.SIGINT)

        timer = threading.Timer(after, press)
        timer.start()
        with self.assertRaises(KeyboardInterrupt):
            call()
            over.append(time.monotonic())
            time.sleep(10)
        self.assertFalse(over, "the call was over before it was interrupted")
        took = time.monotonic() - pressed[0]
        print(f"stopped after {took:.2f} s")
        return took

    def test_calls(self):
        def rays(count, rows=1):
            return mp.foliar.evaluate(np.full(rows, 3.0), 0.2, 1.5, 1.4, 1.35, rays=count)

        expected = rays(300_000, 8)
        elsewhere = []
        # One row, long; meanwhile another thread computes, and what it finds is whole.
        thread = threading.Thread(target=lambda: elsewhere.extend(rays(300_000, 8) for _ in range(3)))
        thread.start()
        self.assertLess(self.interrupted(lambda: rays(1_000_000_000_000)), 5)
        # Short calls right after it.
        self.assertEqual(mp.slab.invert(0.38, 0.51, 0.15, 0.002).status, "ok")
        self.assertGreater(mp.slab.forward(1.0, 9.0, 0.3)[0], 0)
        thread.join()
        self.assertEqual(len(elsewhere), 3)
        for found in elsewhere:
            np.testing.assert_array_equal(found.reflectance, expected.reflectance)

    def test_fits(self):
        with tempfile.TemporaryDirectory() as folder:
            scan, out = f"{folder}/scan", f"{folder}/elm"
            command("synth", "data/leaves/elm.toml", "-o", scan, "--size", "96x72", "--frames", "12")
            self.assertLess(self.interrupted(lambda: mp.leaf.fit(scan, out, hold_out=0), 0.2), 8)
            # Nothing goes on in the background: no fit appears, and the next one is not stopped.
            before = sorted(Path(folder).rglob("*"))
            time.sleep(1)
            self.assertEqual(sorted(Path(folder).rglob("*")), before)
            self.assertFalse((Path(out) / "fit.toml").exists())
            self.assertIn("sigma_a", mp.leaf.fit(scan, out, hold_out=0).front.params)


if __name__ == "__main__":
    unittest.main()
