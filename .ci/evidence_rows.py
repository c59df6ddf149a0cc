"""Rows of measured figures: where they were measured, the table that keeps them, and the page that shows them."""

import csv, datetime, os, platform, subprocess
from pathlib import Path


def processor():
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        name = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        name = platform.processor() or "unknown"
    return f"{name}, {os.cpu_count()} cores"


def commit():
    git = ["git", "-C", str(Path(__file__).resolve().parent), "rev-parse", "--short", "HEAD"]
    return subprocess.run(git, capture_output=True, text=True).stdout.strip() or "unknown"


def today():
    return datetime.date.today().isoformat()


def read(file):
    return list(csv.DictReader(file.open(newline=""))) if file.exists() else []


def write(file, columns, rows, key, parts=()):
    """Writes rows into a table. Earlier rows with the same key are replaced, and so are all of `parts`."""
    again = {tuple(row[name] for name in key) for row in rows}
    kept = [row for row in read(file) if tuple(row[name] for name in key) not in again and row["part"] not in parts]
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_name(file.name + ".part")
    with part.open("w", newline="") as out:
        writer = csv.DictWriter(out, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(kept + rows)
    part.replace(file)


def ways_to_light(found):
    """Rows of `check --compare-methods`."""
    for row in found["methods"]:
        note = f"99 % of FLIP {row['flip_p99']:.3g}, radiance off by {100 * row['rms_over_mean']:.3g} % RMS, " \
            f"{row['light_bytes'] / 1e6:.3g} MB of light"
        yield f"{row['view']}: {row['method']}", row["milliseconds"], "ms a picture", note


def duration(us):
    """A time in µs as a number below a thousand, and its unit."""
    for size, unit in ((1e6, "s"), (1e3, "ms")):
        if us and us >= size:
            return us / size, unit
    return us, "µs"


def table(rows):
    """Rows as a Markdown table."""
    cell = lambda text: text.replace("|", "\\|")
    lines = [f"| {cell(row['what'])} | {row['value']} {row['unit']} | {cell(row['note'])} |\n" for row in rows]
    return "| what | measured | remarks |\n|---|---|---|\n" + "".join(lines)
