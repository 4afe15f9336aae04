#!/usr/bin/env python3
"""Runs the shards of a calib plan as Ray tasks. No disk is shared: inputs go through Ray's object store, once a node,
and a task returns the bytes of what its shard wrote.

    calib_ray.py PLAN [--calib CALIB] [--ship] [--threads N] [--address ADDRESS] [--attempts N] [--no-merge]

A task only starts a process. A node that is lost takes nothing with it but the shards that it was at, which Ray gives to
others. A shard that was asked to stop (75) is tried again from the state that it kept; no other failure is tried again.
Exits with 0 if all shards are done, and with 4 if some are not.
"""

import argparse
import ctypes
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
os.environ.setdefault("RAY_DEDUP_LOGS", "0")

TRY_AGAIN = 75
INCOMPLETE = 4


def number(shard):
    return f"{shard:04d}"


def files_of(plan, shard):
    """What a shard has written so far, by its path in the plan."""
    folder = plan / "shards"
    own = [folder / f"{number(shard)}.units"]
    for kept in ("state", "attempts"):
        own += sorted((folder / f"{number(shard)}.{kept}").glob("*"))
    return {str(path.relative_to(plan)): path.read_bytes() for path in own if path.is_file() and not path.name.endswith(".tmp")}


def put_files(plan, files):
    """Each as a whole or not at all."""
    for name, content in files.items():
        path = plan / name
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(f".{path.name}.{os.getpid()}.part")
        part.write_bytes(content)
        os.replace(part, path)


def die_with_parent():
    """A worker that is gone takes its process with it."""
    try:
        ctypes.CDLL(None).prctl(1, signal.SIGTERM)
    except (OSError, AttributeError):
        pass


def node_folder(key, names, objects, get):
    """The inputs of a plan on this node: unpacked by whoever is first."""
    root = Path(tempfile.gettempdir()) / f"calib-ray-{os.getuid()}"
    place = root / key
    if not place.is_dir():
        root.mkdir(mode=0o700, exist_ok=True)
        own = Path(tempfile.mkdtemp(dir=root))
        for name, content in zip(names, objects):
            path = own / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(get(content))
        try:
            own.rename(place)
        except OSError:
            shutil.rmtree(own, ignore_errors=True)
    return place


def run_shard(shard, key, names, objects, files, calib, threads):
    """On a node: run a shard in a folder of its own, and return its exit code, what it wrote and what it said."""
    import ray

    inputs = node_folder(key, names, objects, ray.get)
    with tempfile.TemporaryDirectory() as folder:
        plan = Path(folder)
        shutil.copyfile(inputs / "plan.json", plan / "plan.json")
        (plan / "inputs").symlink_to(inputs / "inputs", target_is_directory=True)
        (plan / "shards").mkdir()
        put_files(plan, files)
        program = calib
        if (inputs / "program").is_file():
            program = str(plan / "calib")
            shutil.copyfile(inputs / "program", program)
            os.chmod(program, 0o755)
        command = [program, "--quiet", "--threads", str(threads), "cluster", "run", str(plan), "--shard", str(shard)]
        done = subprocess.run(command, capture_output=True, text=True, preexec_fn=die_with_parent)
        return done.returncode, files_of(plan, shard), done.stderr[-2000:]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plan", type=Path)
    parser.add_argument("--calib", default="calib", help="the program, on this machine and on the nodes")
    parser.add_argument("--ship", action="store_true", help="send the program of this machine to the nodes")
    parser.add_argument("--threads", type=int, default=1, help="threads of a task")
    parser.add_argument("--address", help="of a cluster; without it RAY_ADDRESS, or this machine alone")
    parser.add_argument("--attempts", type=int, default=10, help="of a shard that is asked to stop")
    parser.add_argument("--no-merge", action="store_true", help="leave the shards where they are")
    options = parser.parse_args()
    import ray

    ray.init(address=options.address, logging_level="ERROR")
    plan = json.loads((options.plan / "plan.json").read_text())
    failed = run_plan(ray, options, plan)
    ray.shutdown()
    if failed:
        print(f"{len(failed)} of {len(plan['shards'])} shards are not done: {', '.join(map(str, sorted(failed)))}", file=sys.stderr)
        return INCOMPLETE
    if options.no_merge:
        return 0
    return subprocess.run([options.calib, "cluster", "merge", str(options.plan)]).returncode


def run_plan(ray, options, plan):
    """Run what is not done, stage by stage; the shards that failed."""
    inputs = [path for path in [options.plan / "plan.json", *sorted((options.plan / "inputs").rglob("*"))] if path.is_file()]
    names = [str(path.relative_to(options.plan)) for path in inputs]
    objects = [ray.put(path.read_bytes()) for path in inputs]
    if options.ship:
        program = shutil.which(options.calib)
        if program is None:
            sys.exit(f"calib_ray: there is no program {options.calib} here to send")
        names.append("program")
        objects.append(ray.put(Path(program).read_bytes()))
    key = plan["fingerprint"][:16] + ("-shipped" if options.ship else "")
    task = ray.remote(num_cpus=options.threads, max_retries=20)(run_shard)
    failed = set()
    for stage in range(1 + max((shard["stage"] for shard in plan["shards"]), default=-1)):
        # A stage reads the results of earlier stages.
        earlier = {}
        for shard, planned in enumerate(plan["shards"]):
            if planned["stage"] < stage:
                earlier.update({name: content for name, content in files_of(options.plan, shard).items() if name.endswith(".units")})

        def start(shard):
            memory = int(plan["shards"][shard]["memory"])
            files = {**earlier, **files_of(options.plan, shard)}
            return task.options(memory=memory).remote(shard, key, names, objects, files, options.calib, options.threads)

        attempts = {shard: 1 for shard, planned in enumerate(plan["shards"]) if planned["stage"] == stage}
        running = {start(shard): shard for shard in attempts}
        while running:
            [ready], _ = ray.wait(list(running), num_returns=1)
            shard = running.pop(ready)
            try:
                code, files, told = ray.get(ready)
            except ray.exceptions.RayError as error:
                code, files, told = INCOMPLETE, {}, str(error)
            put_files(options.plan, files)
            if code == TRY_AGAIN and attempts[shard] < options.attempts:
                attempts[shard] += 1
                running[start(shard)] = shard
            elif code != 0:
                print(f"shard {shard} ended with {code}: {told.strip()}", file=sys.stderr)
                failed.add(shard)
        if failed:
            break
    return failed


if __name__ == "__main__":
    sys.exit(main())
