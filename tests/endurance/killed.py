"""Kills the program at random moments (kill -9), starts the same command again, and compares what it makes with what an
undisturbed run makes, byte by byte.

    cargo build --release
    python3 tests/endurance/killed.py target/release/mesophyll --kills 200

Only times may differ: `times.toml` of a fit, and what `run` and `render` say of seconds (ledger.json, report.html;
of plan.json, check.json and render.json only the numbers). After each kill every file under its final name must be
whole. At the end no temporary file may be left.
The seed of the moments is printed; exit code 1 where anything was wrong, and where fewer runs were killed than asked
for, since too many had ended before.
"""

import argparse
import json
import pathlib
import random
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]


def small(scene, folder, width, height, samples, more=()):
    """A scene of data/scenes with small pictures; its places made absolute."""
    text = (ROOT / f"data/scenes/{scene}.toml").read_text()
    for near, far in [("../leaves/", ROOT / "data/leaves"), ("../../fits/", ROOT / "fits"),
                      ("../plants/", ROOT / "data/plants")]:
        text = text.replace(f'"{near}', f'"{far}/')
    for name, value in [("width", width), ("height", height), ("samples", samples), ("frames", 1)]:
        text = re.sub(rf"(?m)^{name} = \d+", f"{name} = {value}", text)
    for old, new in more:
        assert old in text, f"{scene}.toml holds no {old!r}"
        text = text.replace(old, new)
    path = folder / f"{scene}.toml"
    path.write_text(text)
    return path


def cases(program, folder, rows=400_000):
    """Name, words of the command without the output, name of the output, words that go on after a kill."""
    elm = ROOT / "data/leaves/elm.toml"
    tree = folder / "sapling.glb"
    run(program, ["grow", ROOT / "data/plants/bird-cherry-sapling.toml", "-o", tree])
    scan = folder / "scan"
    run(program, ["synth", elm, "-o", scan, "--size", "128x96", "--frames", "40"])
    table = folder / "slab.csv"
    chance = random.Random(7)
    with table.open("w") as out:
        out.write("rho_d,rho_t,h\n")
        for _ in range(rows):
            out.write(f"{chance.uniform(.03, .3):.4f},{chance.uniform(.02, .3):.4f},{chance.uniform(.1, .3):.4f}\n")
    unfitted = f'fit = "{ROOT}/fits/elm"\n'
    scanned = ('size = "160x120", frames = 60', 'size = "64x48", frames = 16')
    scenes = {
        "run": small("front-lit", folder, 96, 72, 8, [(unfitted, ""), scanned]),
        "render": small("cluster", folder, 128, 96, 256),
        "transfer": small("between", folder, 48, 36, 4, [("[transfer]\n", "[transfer]\npaths = 256\n")]),
        "film": small("breeze", folder, 64, 48, 4),
    }
    return [
        ("synth", ["synth", elm, "--size", "96x72", "--frames", "60"], "scan", []),
        ("fit leaf", ["fit", "leaf", scan], "fit", []),
        ("fit slab", ["fit", "slab", "--noise", "0.005", "--in", table], "slab.csv", []),
        ("grow", ["grow", ROOT / "data/plants/wych-elm.toml"], "elm.glb", []),
        ("render", ["render", scenes["render"]], "pictures", ["--resume"]),
        ("run", ["run", scenes["run"]], "run", []),
        ("fit transfer", ["fit", "transfer", scenes["transfer"]], "transfer", []),
        ("fit translucency", ["fit", "translucency", ROOT / "fits/elm"], "translucency", []),
        ("fit grass", ["fit", "grass", ROOT / "data/grass/lawn.toml", "--texels", "32x8", "--entries", "8"], "slices",
            []),
        ("fit sky", ["fit", "sky"], "sky", []),
        ("import", ["import", tree], "branches", []),
        ("film", ["film", scenes["film"], "--to", "0.4", "--fps", "20"], "film", []),
        ("export", ["export", ROOT / "fits/elm", "--to", "csv"], "elm.csv", []),
    ]


def run(program, words):
    done = subprocess.run([program, "-q", *map(str, words)], capture_output=True, text=True)
    # 1: a picture of so few samples may miss its mark; that is no failure of the program.
    if done.returncode not in (0, 1) or "panicked" in done.stderr:
        raise SystemExit(f"{' '.join(map(str, words))}: exit code {done.returncode}: {done.stderr}")


def files(place):
    if place.is_file():
        return {place.name: place.read_bytes()} | {
            p.name: p.read_bytes() for p in place.parent.iterdir() if p.name.startswith(f".{place.name}")}
    return {str(p.relative_to(place)): p.read_bytes() for p in sorted(place.rglob("*")) if p.is_file()}


def timeless(name, data):
    """A record without its numbers and places; nothing of what consists of times."""
    if name.endswith(("times.toml", "ledger.json", "report.html")):
        return b""
    return re.sub(rb'"[^"]*/[^"]*"|-?[0-9][0-9.eE+-]*', b"#", data)


def temporary(name):
    last = name.rsplit("/", 1)[-1]
    return last.startswith(".") and last != ".mesophyll"


def broken(name, data):
    """Why a file under its final name is not whole, as far as its own form tells."""
    if name.endswith(".png") and not (data[:4] == b"\x89PNG" and data[-12:] == b"\0\0\0\0IEND\xaeB`\x82"):
        return "no whole PNG"
    if name.endswith(".glb") and (len(data) < 12 or struct.unpack("<I", data[8:12])[0] != len(data)):
        return "no whole glTF"
    if name.endswith(".json"):
        try:
            json.loads(data)
        except ValueError:
            return "no whole JSON"
    if name.endswith((".toml", ".csv", ".html")) and not data.endswith(b"\n") and not data.endswith(b"</html>"):
        return "does not end with a line's end"
    if name.endswith(".exr") and (data[:4] != b"\x76\x2f\x31\x01" or whole_exr(data) is not None):
        return "no whole EXR"
    return None


def whole_exr(data):
    """None where the last block that the table of offsets names ends where the file ends."""
    at = data.find(b"dataWindow\0box2i\0")
    top, bottom = struct.unpack("<i", data[at + 25:at + 29])[0], struct.unpack("<i", data[at + 33:at + 37])[0]
    at = data.find(b"compression\0compression\0")
    lines = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16}.get(data[at + 28], 32)
    blocks = -(-(bottom - top + 1) // lines)
    # The header ends with an empty name after the last attribute.
    at = 8
    while data[at] != 0:
        at = data.index(b"\0", at) + 1
        at = data.index(b"\0", at) + 1
        at += 4 + struct.unpack("<I", data[at:at + 4])[0]
    at += 1
    last = max(struct.unpack(f"<{blocks}Q", data[at:at + 8 * blocks]))
    size = struct.unpack("<I", data[last + 4:last + 8])[0]
    return None if last + 8 + size == len(data) else "truncated"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("program", type=lambda p: pathlib.Path(p).resolve())
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="one case by name, such as `fit leaf`")
    args = parser.parse_args()
    chance = random.Random(args.seed)
    faults = 0
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        todo = [c for c in cases(args.program, folder) if args.only in (None, c[0])]
        if not todo:
            raise SystemExit(f"--only: found {args.only!r}, which is no case")
        for case, words, out, more in todo:
            whole, again = [folder / f"{w}" / out for w in ("whole", "again")]
            for place in (whole, again):
                place.parent.mkdir(exist_ok=True)
            start = time.monotonic()
            run(args.program, [*words, "-o", whole])
            took = time.monotonic() - start
            run(args.program, [*words, "-o", again])
            reference, second = files(whole), files(again)
            # What differs between two undisturbed runs: times.
            differs = {n for n in reference if second.get(n) != reference[n]}
            kills = late = litter = 0
            wanted = -(-args.kills // len(todo))
            while kills < wanted and late < 3 * wanted:
                place = folder / "killed" / out
                place.parent.mkdir(exist_ok=True)
                for restarts in range(min(chance.randint(1, 3), wanted - kills)):
                    words_now = [*words, "-o", place, *(more if place.exists() else [])]
                    child = subprocess.Popen([args.program, "-q", *map(str, words_now)], stdout=subprocess.DEVNULL,
                                             stderr=subprocess.PIPE)
                    time.sleep(chance.uniform(0, took / (1 + restarts)))
                    child.kill()
                    said = child.communicate()[1].decode()
                    late += child.returncode >= 0
                    kills += child.returncode < 0
                    if child.returncode > 1:
                        faults += 1
                        print(f"{case}: started again, it ended with {child.returncode}: {said}")
                    for file, data in files(place).items() if place.exists() else ():
                        if not temporary(file) and (why := broken(file, data)):
                            faults += 1
                            print(f"{case}: after a kill {file} is broken: {why}")
                run(args.program, [*words, "-o", place, *(more if place.exists() else [])])
                made = files(place)
                litter += sum(map(temporary, made))
                for file in sorted(set(made) | set(reference)):
                    if temporary(file):
                        continue
                    pair = [made.get(file), reference.get(file)]
                    if file in differs and None not in pair:
                        pair = [timeless(file, data) for data in pair]
                    if pair[0] != pair[1]:
                        faults += 1
                        state = "missing" if file not in made else "new" if file not in reference else "different"
                        print(f"{case}: {file} is {state} after a kill")
                shutil.rmtree(folder / "killed")
            faults += litter
            if kills < wanted:
                faults += 1
                print(f"{case}: {kills} kills, expected {wanted}")
            print(f"{case}: {kills} kills ({late} came after the end), {took:.1f} s a run, {litter} temporary files "
                  f"left; times differ in: {', '.join(sorted(differs)) or 'nothing'}", flush=True)
    print(f"seed {args.seed}: {faults} faults")
    return faults > 0


if __name__ == "__main__":
    sys.exit(main())
