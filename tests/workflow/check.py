"""Runs data/workflow with real Snakemake on small leaves and a table of a million rows, kills or cancels jobs on the
way, and compares everything with what one run of the program makes, byte by byte. Then it adds a leaf, scans one again,
and changes the options of the leaves and of the table: what that concerns has to be made again, and nothing else. Exit
code 1 where anything was wrong, and where fewer jobs were stopped than meant.

    cargo build --release
    pip install snakemake snakemake-executor-plugin-slurm
    python3 tests/workflow/check.py target/release/mesophyll            # on this machine
    sudo python3 tests/workflow/check.py target/release/mesophyll --slurm   # with a real Slurm on this one machine

`--slurm` needs root and Debian's packages `slurm-wlm` and `munge`, and a machine that has no Slurm of its own: it
writes /etc/slurm/slurm.conf (jobs of Snakemake look nowhere else), starts munged, slurmctld and slurmd with everything
else in a temporary folder, and at the end stops them and removes that file, whatever happens.
"""

import argparse
import os
import pathlib
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
# Jobs to stop on the way.
KILLS = 3


class Slurm:
    """munged, slurmctld and slurmd of this one machine, under a temporary folder."""

    def __init__(self, folder):
        self.folder, self.started = folder, []
        os.environ["PATH"] += ":/usr/sbin:/sbin"
        for program in ("munged", "slurmctld", "slurmd"):
            if shutil.which(program) is None:
                raise SystemExit(f"{program} is not installed: apt-get install slurm-wlm munge")
        folder.mkdir(mode=0o755)
        key, sock = folder / "munge.key", folder / "munge.socket"
        key.write_bytes(os.urandom(128))
        key.chmod(0o400)
        host, cores = socket.gethostname().split(".")[0], os.cpu_count()
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2**20
        conf = self.conf = pathlib.Path("/etc/slurm/slurm.conf")
        if conf.exists():
            raise SystemExit(f"{conf} is there: this machine has a Slurm of its own, which this test would disturb")
        conf.parent.mkdir(exist_ok=True)
        conf.write_text(f"""ClusterName=test
SlurmctldHost={host}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={sock}
CryptoType=crypto/munge
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SchedulerType=sched/backfill
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
ReturnToService=2
MinJobAge=600
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
SlurmctldPort=16817
SlurmdPort=16818
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
NodeName={host} NodeAddr=127.0.0.1 CPUs={cores} RealMemory={memory} State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
""")
        for name in ("state", "spool"):
            (folder / name).mkdir()
        self.start(["munged", "-F", "--force", f"--key-file={key}", f"--socket={sock}",
            f"--pid-file={folder}/munged.pid",
                    f"--log-file={folder}/munged.log", f"--seed-file={folder}/munged.seed"])
        time.sleep(1)
        self.start(["slurmctld", "-D", "-c", "-f", str(conf)])
        self.start(["slurmd", "-D", "-f", str(conf)])
        for _ in range(30):
            time.sleep(1)
            told = subprocess.run(["sinfo", "-h", "-o", "%t"], capture_output=True, text=True).stdout.split()
            if told and told[0].rstrip("*") in ("idle", "mix", "alloc") and not told[0].endswith("*"):
                return
        logs = "".join(p.read_text()[-2000:] for p in folder.glob("*.log"))
        self.stop()
        raise SystemExit(f"Slurm did not start: {logs}")

    def start(self, words):
        self.started.append(subprocess.Popen(words, stdout=subprocess.DEVNULL,
                                             stderr=subprocess.DEVNULL, start_new_session=True))

    def stop(self):
        for process in reversed(self.started):
            process.terminate()
            process.wait()
        self.conf.unlink()


def inputs(program, folder, leaves, rows):
    """Captures, one of them four times the size of the others, and a table with some rows that are refused."""
    for k in range(leaves):
        size = "128x96" if k == 0 else "64x48"
        words = [program, "-q", "synth", ROOT / "data/leaves/elm.toml", "-o", folder / f"scans/elm-{k}", "--size", size,
                 "--frames", "30", "--seed", str(k + 1)]
        subprocess.run(list(map(str, words)), check=True)
    chance = random.Random(3)
    with (folder / "table.csv").open("w") as table:
        table.write("leaf,rho_d,rho_t,h\n")
        for k in range(rows):
            bad = "" if k % 1000 else "x"
            table.write(f"{k},{bad}{chance.uniform(.03, .3):.4f},{chance.uniform(.02, .3):.4f},.2\n")


def whole(program, folder, leaves, noise="0.005"):
    """What one run of the program makes of the same inputs."""
    for k in range(leaves):
        words = [program, "-q", "fit", "leaf", folder / f"scans/elm-{k}", "-o", folder / f"whole/elm-{k}"]
        subprocess.run(list(map(str, words)), check=True, stdout=subprocess.DEVNULL)
    words = [program, "-q", "fit", "slab", "--noise", noise, "--in", folder / "table.csv"]
    words += ["-o", folder / "whole/table.csv"]
    subprocess.run(list(map(str, words)), check=True, stdout=subprocess.DEVNULL)


def changes(program, folder, leaves, words):
    """Changes one thing after the other and starts the workflow again. Returns the number of faults: something is made
    again that the change does not concern, or is not made again that it does."""
    faults = 0

    def times():
        return {str(p.relative_to(folder / "results")): p.stat().st_mtime_ns
                for p in [*(folder / "results/fits").glob("*/fit.toml"), folder / "results/table.csv"]}

    def expect(case, wanted, *more):
        nonlocal faults
        before = times()
        ended = subprocess.run([*map(str, words), *more], capture_output=True, text=True)
        made = {name for name, at in times().items() if before.get(name) != at}
        if ended.returncode != 0 or made != wanted:
            faults += 1
            print(f"{case}: made again {sorted(made)}, expected {sorted(wanted)}")
            print(ended.stderr[-3000:] if ended.returncode != 0 else "")

    def scan(name, *more):
        done = [program, "-q", "synth", ROOT / "data/leaves/elm.toml", "-o", folder / "scans" / name, "--size", "64x48",
                "--force", *more]
        subprocess.run(list(map(str, done)), check=True)

    fits = {f"fits/elm-{k}/fit.toml" for k in range(leaves)}
    expect("nothing changed", set())
    expect("other sizes of jobs", set(), "minutes=0.02", "readings_per_second=300000")
    # Before all others in the list, so that every job after it would have another number.
    scan("added", "--frames", "30", "--seed", "77")
    expect("a leaf was added", {"fits/added/fit.toml"})
    scan("elm-1", "--frames", "30", "--seed", "78")
    expect("a leaf was scanned again", {"fits/elm-1/fit.toml"})
    scan("dome", "--acquisition", "dome")
    expect("a capture under a dome", {"fits/dome/fit.toml"})
    shutil.rmtree(folder / "scans/dome")
    fits.add("fits/added/fit.toml")
    expect("other options of the leaves", fits, "leaf_options=--hold-out 0")
    expect("the former options of the leaves", fits)
    expect("another verb of the table", {"table.csv"}, "verb=fit slab --noise 0.01")
    whole(program, folder, 0, "0.01")
    if (folder / "whole/table.csv").read_bytes() != (folder / "results/table.csv").read_bytes():
        faults += 1
        print("another verb of the table: the answer is not what one run makes")
    expect("the former verb of the table", {"table.csv"})
    scan("beams", "--acquisition", "beams")
    ended = subprocess.run(list(map(str, words)), capture_output=True, text=True)
    if ended.returncode == 0 or "scans/beams/capture.toml: kind" not in ended.stderr or "Traceback" in ended.stderr:
        faults += 1
        print(f"a capture that `fit leaf` does not take: {ended.stderr[-1000:]}")
    return faults


def disturb(folder, slurm, stop, done):
    """Kills running jobs, with time in between; with Slurm it cancels them. The jobs of this test are those that run in
    its own folder."""
    while len(done) < KILLS and not stop.wait(0.3):
        if slurm:
            told = subprocess.run(["squeue", "-h", "-t", "RUNNING", "-o", "%i"], capture_output=True, text=True).stdout
            for job in told.split()[:1]:
                time.sleep(1.5)
                subprocess.run(["scancel", job])
                stop.wait(12)
                told = subprocess.run(["scontrol", "show", "job", job], capture_output=True, text=True).stdout
                # A job may have ended just before.
                if "JobState=CANCELLED" in told:
                    done.append(job)
        else:
            for place in pathlib.Path("/proc").glob("[0-9]*"):
                try:
                    words = (place / "cmdline").read_bytes().split(b"\0")
                    if place.joinpath("cwd").readlink() == folder and {b"--shard", b"--noise"} & set(words):
                        os.kill(int(place.name), signal.SIGKILL)
                        done.append(place.name)
                        stop.wait(2)
                        break
                except OSError:
                    pass


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("program", type=lambda p: pathlib.Path(p).resolve())
    parser.add_argument("--slurm", action="store_true")
    parser.add_argument("--leaves", type=int, default=4)
    parser.add_argument("--rows", type=int, default=1_000_000)
    args = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        folder.chmod(0o755)
        inputs(args.program, folder, args.leaves, args.rows)
        whole(args.program, folder, args.leaves)
        slurm = Slurm(folder / "slurm") if args.slurm else None
        stop, done = threading.Event(), []
        killer = threading.Thread(target=disturb, args=(folder.resolve(), args.slurm, stop, done))
        killer.start()
        try:
            # Shards of some seconds in place of minutes.
            words = [sys.executable, "-m", "snakemake", "-s", ROOT / "data/workflow/Snakefile", "--profile",
                     ROOT / "data/workflow" / ("slurm" if args.slurm else "local"), "--directory", folder]
            if args.slurm:
                words += ["--slurm-status-command", "squeue", "--slurm-init-seconds-before-status-checks", "3",
                          "--seconds-between-status-checks", "3", "--latency-wait", "5"]
            values = ["--config", f"program={args.program}", "captures=scans", "table=table.csv", "out=results",
                      "minutes=0.01", "readings_per_second=400000", f"rows_per_second={args.rows / 2.4}"]
            words += values
            start = time.monotonic()
            ended = subprocess.run(list(map(str, words)), capture_output=True, text=True)
            took = time.monotonic() - start
        finally:
            stop.set()
            killer.join()
            if slurm:
                slurm.stop()
        if ended.returncode != 0:
            print(ended.stderr[-6000:])
            return 1
        faults = 0
        pairs = [(folder / "whole/table.csv", folder / "results/table.csv")]
        for k in range(args.leaves):
            files = {p.name for at in ("whole", "results/fits") for p in (folder / at / f"elm-{k}").rglob("*")}
            pairs += [(folder / f"whole/elm-{k}" / n,
                folder / f"results/fits/elm-{k}" / n) for n in sorted(files - {"times.toml"})]
        for one, other in pairs:
            if not (one.exists() and other.exists() and one.read_bytes() == other.read_bytes()):
                print(f"{other.relative_to(folder)} is not what one run makes")
                faults += 1
        # A run may have ended just before its signal came; Snakemake says which ones were killed.
        stopped = len(done) if args.slurm else ended.stderr.count("died with <Signals.SIGKILL")
        if stopped < KILLS:
            print(f"{stopped} jobs were stopped, expected {KILLS}")
            faults += 1
        jobs = ended.stderr.count("Finished jobid") + ended.stderr.count("Finished job ")
        print(f"{jobs} jobs in {took:.0f} s, {stopped} of them {'cancelled' if args.slurm else 'killed'}; {len(pairs)} "
              f"files compared, {faults} faults")
        local = [sys.executable, "-m", "snakemake", "-s", ROOT / "data/workflow/Snakefile", "--profile",
                 ROOT / "data/workflow/local", "--directory", folder]
        changed = changes(args.program, folder, args.leaves, [*local, *values])
        print(f"changes of inputs and options: {changed} faults")
        return faults + changed > 0


if __name__ == "__main__":
    sys.exit(main())
