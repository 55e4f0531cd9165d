"""Runs each step of Isocortex and what other programs do in its place, turn by turn on one head, and prints the ratios.

Times are processor times of the whole process, the least of the rounds: what others on the machine disturb least. A peer that
cannot be had or fails is named and left out. With --json the figures are written as JSON as well.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from stages import STAGES, Inputs


class Isocortex:
    """The program `isocortex-bench`, which takes one step each time it is run."""

    def __init__(self, program, volume, mask, closing_mm):
        self.program = program
        self.head = ["--volume", volume, "--mask", mask, "--closing-radius-mm", str(closing_mm), "--threads", "1"]

    def step(self, name, *options):
        command = [self.program, "step", name, *self.head, *options]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
        if done.returncode:
            sys.exit(f"isocortex-bench ended with {done.returncode}")
        return json.loads(done.stdout)


def timed(step):
    wall, cpu = time.perf_counter(), time.process_time()
    check = step()
    return {"wall_s": time.perf_counter() - wall, "cpu_s": time.process_time() - cpu, "check": check}


def made(peers, inputs):
    """The peers whose input can be prepared, and why the others' cannot."""
    ready, missing = [], []
    for name, make in peers:
        try:
            ready.append((name, make(inputs)))
        except Exception as error:  # a package that is missing or does not work here is no failure of the others
            missing.append((name, f"{type(error).__name__}: {error}"))
    return ready, missing


def measure(isocortex, step, inputs, rounds):
    peers, tolerance = STAGES[step]
    ready, missing = made(peers, inputs)
    found = {"isocortex": [], **{name: [] for name, _ in ready}}
    for _ in range(rounds):
        found["isocortex"].append(isocortex.step(step))
        for name, peer in ready:
            found[name].append(timed(peer))
    ours = found["isocortex"][-1]["check"]
    rows = []
    for name, runs in found.items():
        # Where the system does not tell a processor time, the wall time stands for it.
        cpu = min(run["cpu_s"] if run["cpu_s"] is not None else run["wall_s"] for run in runs)
        check = runs[-1]["check"]
        agrees = tolerance is None or abs(check - ours) <= tolerance * max(abs(ours), 1e-9)
        row = {"step": step, "program": name, "cpu_ms": 1e3 * cpu, "wall_ms": 1e3 * min(run["wall_s"] for run in runs)}
        rows.append({**row, "check": check, "agrees": agrees if tolerance is not None else None})
    for row in rows:
        row["times_ours"] = row["cpu_ms"] / rows[0]["cpu_ms"]
    return rows, missing


def number(value):
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"


def show(rows, missing):
    for row in rows:
        agrees = {None: "", True: "same", False: "OTHER"}[row["agrees"]]
        figures = f"{number(row['cpu_ms']):>10} {number(row['wall_ms']):>10} {number(row['times_ours']):>10}"
        print(f"  {row['step']:<9} {row['program']:<16} {figures}  {number(row['check']):>12} {agrees}")
    for name, why in missing:
        print(f"  {rows[0]['step']:<9} {name:<16} left out: {why[:120]}")
    sys.stdout.flush()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--isocortex-bench", required=True)
    parser.add_argument("--volume", required=True)
    parser.add_argument("--mask", required=True)
    parser.add_argument("--closing-radius-mm", type=float, default=10.0)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", default=",".join(STAGES))
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as directory:
        closing_mm = arguments.closing_radius_mm
        isocortex = Isocortex(arguments.isocortex_bench, arguments.volume, arguments.mask, closing_mm)
        envelope = Path(directory) / "envelope.nii.gz"
        isocortex.step("decode", "--envelope", envelope)
        inputs = Inputs(arguments.volume, arguments.mask, envelope, closing_mm)
        print(f"  {'step':<9} {'program':<16} {'CPU, ms':>10} {'wall, ms':>10} {'× ours':>10}  {'result':>12}")
        everything = []
        for step in arguments.steps.split(","):
            rows, missing = measure(isocortex, step, inputs, arguments.rounds)
            show(rows, missing)
            everything += rows
    print("  CPU is the least of the rounds, one thread each where the program can be told. × ours: above 1, Isocortex is faster.")
    print("  A new depth makes a whole surface in VTK and scikit-image; Isocortex moves 1,800 triangles.")
    if arguments.json:
        arguments.json.write_text(json.dumps(everything, indent=2) + "\n")


if __name__ == "__main__":
    main()
