"""Canopies that other programs have answers for, by `mesophyll eval canopy`: RAMI-3 and RAMI4PILPS. Their data are
found through MESOPHYLL_DATA."""

import csv, gzip, io, math, os, random, time
from pathlib import Path

# Leaves of each canopy: name, file of discs, file of places, reflectance, transmittance.
ROMC = {
    "het01": (100.0, 0.159, [("sphere", "het01_discs", "het01_instances.txt", 0.4957, 0.4409)]),
    "het04": (270.0, 0.15, [("sphere", "het04_sphere_discs", "het04_sphere_positions.txt", 0.49, 0.41),
                            ("cylinder", "het04_cylinder_discs", "het04_cylinder_positions.txt", 0.45, 0.3)]),
}
PATHS, PATHS_OF_FLUXES = 1 << 17, 1 << 17
# The open forest: spheres by leaf area, their radius (m), discs a sphere, and the side of the square (m).
SPHERES, RADIUS, DISCS, SIDE = {"0.50265": 80, "1.5017": 239, "2.5007": 398}, 5.0, 50000, 250.0
LEAF_AREA_OF_SPHERE = 5.0
# Nobody knows where the trees of the published answers stand: the mean over so many random placements is compared.
PLACEMENTS = 4


def scene(file, side_m, leaves, ground, sun_zenith):
    three = lambda v: f"[{v}, {v}, {v}]"
    text = f'schema = 1\nname = "canopy"\n[periodic]\nsize_mm = [{side_m * 1e3}, {side_m * 1e3}]\n' \
        f"[ground]\nalbedo = {three(ground)}\n" \
        f"[sun]\nzenith_deg = {sun_zenith}\nradius_deg = 0\nirradiance = [1, 1, 1]\n"
    for name, discs, places, r, t in leaves:
        text += f'[[leaf]]\nname = "{name}"\ndiscs = "{discs}.txt"\nuniform = {{ rho_d = [{three(r)}, {three(r)}], ' \
            f'rho_t = {three(t)} }}\n[[instance]]\nleaf = "{name}"\npositions = "{places}"\n'
    file.write_text(text)


def evaluate(run, *arguments):
    start = time.monotonic()
    text = run.text("eval", "canopy", *map(str, arguments))
    return list(csv.DictReader(io.StringIO(text))), time.monotonic() - start


def reflectance_factors(run, data, folder):
    for name, (side, ground, leaves) in ROMC.items():
        for _, discs, places, *_ in leaves:
            (folder / f"{discs}.txt").write_bytes(gzip.decompress((data / f"{discs}.txt.gz").read_bytes()))
            (folder / places).write_bytes((data / places).read_bytes())
        scene(folder / "canopy.toml", side, leaves, ground, 20)
        known = [row for row in csv.DictReader((data / "romc_brfpp.csv").open()) if row["scene"] == name]
        (folder / "directions.csv").write_text(
            "view_zenith_deg\n" + "".join(row["view_zenith_deg"] + "\n" for row in known))
        directions = ["--directions", folder / "directions.csv", "--samples", PATHS]
        found, seconds = evaluate(run, folder / "canopy.toml", *directions)
        n = len(known)
        pairs = [[float(v) for v in (f["brf"], f["brf_err"], k["brf"], k["brf_se"])] for f, k in zip(found, known)]
        chi2 = sum((brf - want) ** 2 / (error**2 + theirs**2) for brf, error, want, theirs in pairs)
        ratio = sum(brf / want for brf, _, want, _ in pairs) / n
        error = sum(error / want for _, error, want, _ in pairs) / n
        # Wilson & Hilferty 1931.
        z = ((chi2 / n) ** (1 / 3) - (1 - 2 / (9 * n))) / math.sqrt(2 / (9 * n))
        yield f"RAMI-3 {name.upper()}: χ² of {n} reflectance factors", chi2, "", \
            f"p = {0.5 * math.erfc(z / 2**0.5):.2g}; {PATHS} paths a direction, standard error {100 * error:.2g} %"
        yield f"RAMI-3 {name.upper()}: mean ratio to the ROMC", ratio, "", "the mean over these directions"
        yield f"RAMI-3 {name.upper()}: time", seconds, "s", "of these directions, with reading"


def forest(count, folder, chance):
    """Discs of a sphere, even inside and in all directions, and centres of spheres that do not overlap."""
    def ball(radius):
        while True:
            p = [chance.uniform(-radius, radius) for _ in range(3)]
            if 0 < sum(v * v for v in p) <= radius * radius:
                return p
    area = LEAF_AREA_OF_SPHERE * math.pi * RADIUS**2
    disc = math.sqrt(area / DISCS / math.pi)
    unit = lambda p: [v / math.sqrt(sum(w * w for w in p)) for v in p]
    lines = (" ".join(f"{v:.6g}" for v in [disc, *ball(RADIUS), *unit(ball(1.0))]) for _ in range(DISCS))
    (folder / "tree.txt").write_text("\n".join(lines) + "\n")
    centres = []
    while len(centres) < count:
        at = [chance.uniform(0, SIDE), chance.uniform(0, SIDE), chance.uniform(7, 11)]
        near = lambda other: sum(min(abs(a - b), SIDE - abs(a - b)) ** 2 if k < 2 else (a - b) ** 2
                                 for k, (a, b) in enumerate(zip(at, other))) < (2 * RADIUS) ** 2
        if not any(near(other) for other in centres):
            centres.append(at)
    (folder / "trees.txt").write_text("".join(" ".join(f"{v:.6g}" for v in c) + "\n" for c in centres))


def shares(run, data, folder):
    names = {"reflected": "reflected", "absorbed": "absorbed", "transmitted": "transmitted_to_ground"}
    off, start = {}, time.monotonic()
    for lai, group in SPHERES.items():
        cases = [row for row in csv.DictReader((data / "rami4pilps_ofc.csv").open()) if float(row["lai"]) == float(lai)]
        for seed in range(PLACEMENTS):
            forest(group, folder, random.Random(seed))
            for k, row in enumerate(cases):
                leaf = ("tree", "tree", "trees.txt", row["leaf_reflectance"], row["leaf_transmittance"])
                scene(folder / "forest.toml", SIDE, [leaf], row["soil_albedo"], row["sun_zenith_deg"])
                found, _ = evaluate(run, folder / "forest.toml", "--fluxes", "--samples", PATHS_OF_FLUXES)
                for ours, theirs in names.items():
                    off.setdefault((lai, k), {}).setdefault(ours, []).append(float(found[0][ours]) - float(row[theirs]))
    worst = [max(abs(sum(each)) / PLACEMENTS for each in case.values()) for case in off.values()]
    scatter = max(max(each) - min(each) for case in off.values() for each in case.values())
    yield "RAMI4PILPS open forest: cases within .01", sum(w <= 0.01 for w in worst), f"of {len(worst)}", \
        f"absorbed, reflected, transmitted; mean of {PLACEMENTS} random placements of the trees"
    yield "RAMI4PILPS open forest: largest error", max(worst), "", \
        f"placements differ by up to {scatter:.2g} from each other; {PATHS_OF_FLUXES} paths a case"
    yield "RAMI4PILPS open forest: time", time.monotonic() - start, "s", "of all cases and placements"


def rows(run, folder):
    place = os.environ.get("MESOPHYLL_DATA")
    data = Path(place or "") / "rami"
    if not place or not data.is_dir():
        raise RuntimeError("MESOPHYLL_DATA names no folder with rami/, which has the canopies")
    folder.mkdir(parents=True, exist_ok=True)
    yield from reflectance_factors(run, data, folder)
    yield from shares(run, data, folder)
