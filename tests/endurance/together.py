"""Starts the same command twice into one place, and shards of one fit all at once.

    cargo build --release
    python3 tests/endurance/together.py target/release/mesophyll

Of two runs into one folder the second one is refused with exit code 2 and one sentence, and the first one ends with the
bytes of an undisturbed run. Two runs that write one file may also both succeed, one after the other. Shards share a
folder: all succeed, whoever ends last, with the bytes of one run. Exit code 1 where anything was wrong, and where no
run was long enough to be in the way of another.
"""

import argparse
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from killed import cases, files, temporary, timeless


def differ(reference, place, times):
    """Names of files that are not those of the reference, as far as they are not times."""
    made = files(place) if place.exists() else {}
    same = lambda n: n in made and n in reference and (
        made[n] == reference[n] or n in times and timeless(n, made[n]) == timeless(n, reference[n]))
    return [n for n in sorted(set(made) | set(reference)) if temporary(n) or not same(n)]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("program", type=lambda p: pathlib.Path(p).resolve())
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    faults = due = 0

    def fault(*words):
        nonlocal faults
        faults += 1
        print(*words)

    def start(words, out):
        return subprocess.Popen([args.program, "-q", *map(str, words), "-o", out], stdout=subprocess.DEVNULL,
                                stderr=subprocess.PIPE, text=True)

    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for case, words, out, _ in cases(args.program, folder, 100_000):
            whole, place = [folder / where / out for where in ("whole", "both")]
            whole.parent.mkdir(exist_ok=True)
            clock = time.monotonic()
            start(words, whole).communicate()
            took = time.monotonic() - clock
            reference, refused = files(whole), 0
            times = {n for n in reference if n.endswith(("times.toml", "ledger.json", "report.html", "plan.json",
                                                         "check.json", "render.json"))}
            for k in range(args.rounds):
                place.parent.mkdir(exist_ok=True)
                first = start(words, place)
                wait = took * (k + 0.3) / (args.rounds + 1)
                time.sleep(wait)
                running = first.poll() is None
                second = start(words, place)
                told = [p.communicate()[1].strip() for p in (first, second)]
                codes = [p.returncode for p in (first, second)]
                # A fit that has not claimed its folder yet may be overtaken; then it is the first one that is refused.
                for code, said in zip(codes, told):
                    if code == 2 and len(said.splitlines()) == 1 and "another run" in said:
                        refused += 1
                    elif code == 2 and not running and "is not empty" in said:
                        pass  # The first synthesis had ended already.
                    elif code not in (0, 1) or "panicked" in said:
                        fault(f"{case}: {code}: {said}")
                if codes == [2, 2]:
                    fault(f"{case}: both were refused")
                # A run with little left to do may have ended before the other one claims its folder.
                if whole.is_dir() and took - wait > max(1, took / 2):
                    due += 1
                    if 2 not in codes:
                        fault(f"{case}: both wrote one folder, the second one started after {wait:.1f} of {took:.1f} s")
                if wrong := differ(reference, place, times):
                    fault(f"{case}: {', '.join(wrong)} differ; exit codes {codes}, first one running: {running}")
                shutil.rmtree(place.parent)
            print(f"{case}: one of two was refused in {refused} of {args.rounds} rounds", flush=True)
        if due == 0:
            fault("no run into a folder had more than a second left when the second one started: nothing was tried")
        whole = folder / "whole/fit"
        reference = files(whole)
        for k in range(args.rounds):
            place = folder / "shards"
            words = ["fit", "leaf", folder / "scan"]
            shards = [start([*words, "--threads", "1", "--shard", f"{i}/4"], place) for i in range(1, 5)]
            told = [p.communicate()[1].strip() for p in shards]
            if any(p.returncode for p in shards):
                fault(f"shards: {told}")
            start([*words, "--merge"], place).communicate()
            if wrong := differ(reference, place, {"times.toml"}):
                fault(f"shards: {', '.join(wrong)} differ: {told}")
            shutil.rmtree(place)
        print(f"{args.rounds} rounds of 4 shards at once")
    print(f"{faults} faults")
    return faults > 0


if __name__ == "__main__":
    sys.exit(main())
