"""Lets every verb that writes run into a full disk, and into a limit of a file's size.

    cargo build --release
    sudo python3 tests/endurance/full_disk.py target/release/mesophyll

The disk is a small tmpfs, which only root can mount; without root only the limit of a file's size is tried. Each
command first runs with room enough, which says how much it writes; then it runs again with less, at several sizes.
Expected: exit code 1, one sentence that names a file and says what is wrong, no panic, and no file under its final name
that differs from the one of the whole run. A run that ends as if there were room has to have written everything. Exit
code 1 where that is not so, and where a verb was never refused.
"""

import argparse
import os
import pathlib
import resource
import shutil
import signal
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from killed import ROOT, broken, cases, files, temporary, timeless


def more_cases(folder):
    elm = ROOT / "fits/elm"
    scan = folder / "scan"
    cases = [(f"export {to}", ["export", elm, "--to", to], f"elm.{ending}", [])
             for to, ending in [("exr", "exr"), ("json", "json"), ("gltf", "glb"), ("gltf-translucent", "glb"),
                                ("obj", "obj"), ("png", "png"), ("packed", "packed")]]
    return cases + [
        ("report", ["report", elm], "elm.html", []),
        ("eval slab", ["eval", "slab", "--in", ROOT / "data/tables/optics.csv"], "optics.csv", []),
        ("eval panorama", ["eval", "panorama", "--sun-zenith-deg", "50", "--turbidity", "3"], "sky.exr", []),
        ("fit sky", ["fit", "sky", "--bands", "3", "--method", "compact"], "sky", []),
        ("bench beam", ["bench", "beam"], "bench", []),
        ("synth dome", ["synth", ROOT / "data/leaves/elm.toml", "--acquisition", "dome", "--size", "48x36"], "dome",
            []),
        ("export pivots", ["export", ROOT / "data/scenes/breeze.toml", "--to", "pivots"], "pivots", []),
        ("fit leaf, a shard", ["fit", "leaf", scan, "--shard", "1/2"], "shard", []),
    ]


def judge(case, size, done, place, reference, differs, ended):
    """Number of faults, each of which is printed; None where the run had room. `ended` is the whole run's exit code."""
    said = done.stderr.strip()
    faults = []
    made = files(place) if place.exists() else {}
    if done.returncode == ended and "cannot write" not in said:
        for name in sorted(set(made) | set(reference)):
            pair = [made.get(name), reference.get(name)]
            if name in differs and None not in pair:
                pair = [timeless(name, data) for data in pair]
            if pair[0] != pair[1]:
                faults.append(f"{name} is not the whole run's")
        if faults:
            print(f"{case}, {size}: exit code {ended}, but {'; '.join(faults)}")
        return len(faults) or None
    if done.returncode == 1 and "cannot write" not in said:
        faults.append("not refused for want of room")
    if done.returncode != 1:
        faults.append(f"exit code {done.returncode}")
    if "panicked" in said:
        faults.append("a panic")
    if len(said.splitlines()) != 1:
        faults.append(f"{len(said.splitlines())} lines")
    if not any(w in said for w in ("the disk is full", "largest size allowed", "No space")):
        faults.append("no reason")
    for name, data in made.items():
        if temporary(name):
            faults.append(f"{name} is left")
        elif why := broken(name, data):
            faults.append(f"{name}: {why}")
        elif name in reference and name not in differs and data != reference[name] and "progress" not in name:
            faults.append(f"{name} differs from the whole run's")
    if faults:
        print(f"{case}, {size}: {'; '.join(faults)}: {said}")
    return len(faults)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("program", type=lambda p: pathlib.Path(p).resolve())
    parser.add_argument("--only")
    args = parser.parse_args()
    faults = tried = 0
    # A file that grows too large is then an error of the write, not the end of the program.
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        disk = folder / "disk"
        disk.mkdir()
        for case, words, out, more in cases(args.program, folder, 20_000) + more_cases(folder):
            if args.only not in (None, case):
                continue
            words = [args.program, "-q", *map(str, words), "-o"]
            whole = folder / "whole" / out
            whole.parent.mkdir(exist_ok=True)
            ended = subprocess.run([*words, whole], capture_output=True).returncode
            reference = files(whole)
            second = folder / "second" / out
            second.parent.mkdir(exist_ok=True)
            subprocess.run([*words, second], capture_output=True)
            differs = {n for n, data in files(second).items() if reference.get(n) != data}
            total, largest = sum(map(len, reference.values())), max(map(len, reference.values()))
            told = 0
            for part in (0, 0.1, 0.35, 0.6, 0.9, 0.97):
                place = disk / out
                if os.geteuid() == 0:
                    size = max(int(total * part), 4096)
                    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "none", disk], check=True)
                    try:
                        done = subprocess.run([*words, place], capture_output=True, text=True)
                        found = judge(case, f"disk of {size} bytes", done, place, reference, differs, ended)
                    finally:
                        subprocess.run(["umount", disk], check=True)
                    tried += 1
                    told += found is not None
                    faults += found or 0
                size = int(largest * part)
                place = folder / "limited" / out
                place.parent.mkdir(exist_ok=True)
                done = subprocess.run([*words, place], capture_output=True, text=True,
                                      restore_signals=False,
                                      preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size)))
                found = judge(case, f"files of {size} bytes", done, place, reference, differs, ended)
                shutil.rmtree(place.parent)
                tried += 1
                told += found is not None
                faults += found or 0
            faults += told == 0
            print(f"{case}: refused {told} times", flush=True)
    print(f"{tried} runs, {faults} faults")
    return faults > 0 or tried == 0


if __name__ == "__main__":
    sys.exit(main())
