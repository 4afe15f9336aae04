"""What the scripts of this folder share: where things are built, who the peers are, which machine this is."""

import json
import os
import pathlib
import platform
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
THREAD_VARIABLES = (
    "OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS",
)


def target():
    return pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")).resolve()


def threads(count):
    """Returns the environment of a process that may use `count` threads, whatever library it computes with."""
    return {**os.environ, **{name: str(count) for name in THREAD_VARIABLES}}


def build(package, example):
    """Builds an example program in release mode."""
    command = ["cargo", "build", "--release", "--locked", "--quiet", "-p", package, "--example", example]
    subprocess.run(command, check=True, cwd=ROOT)
    return str(target() / "release" / "examples" / example)


def environment(name, pinned, first_index=None):
    """Returns the Python of the virtual environment `name`, and the pinned packages that could be installed.

    `first_index` is asked before the usual index, because it may have smaller builds of the same version.
    """
    folder = target() / "peers" / name
    python = folder / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    installed = []
    for package, version in pinned.items():
        found = subprocess.run(
            [python, "-c", f"import importlib.metadata as m; print(m.version({package!r}))"], capture_output=True, text=True
        )
        if found.stdout.strip().split("+")[0] == version:
            installed.append(package)
            continue
        install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", f"{package}=={version}"]
        tries = [[*install, "--retries", "0", "--index-url", first_index]] if first_index else []
        for command in [*tries, install]:
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode == 0:
                installed.append(package)
                break
        else:
            reason = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
            print(f"skipped: {package} {version} does not install ({reason})", file=sys.stderr)
    return str(python), installed


def machine():
    """Returns the name of the processor and the number of cores."""
    try:
        lines = pathlib.Path("/proc/cpuinfo").read_text().splitlines()
        name = next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        name = platform.processor()
    return f"{name}, {os.cpu_count()} logical processors"


def commit():
    """Returns the measured commit, and whether the working tree differs from it."""
    git = lambda *arguments: subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True).stdout.strip()
    return git("rev-parse", "--short", "HEAD") + (" with changes" if git("status", "--porcelain", "-uno") else "")


def peak_kib():
    """Returns the peak memory of this process."""
    for line in open("/proc/self/status"):
        if line.startswith("VmHWM:"):
            return int(line.split()[1])
    return 0


def together(commands):
    """Runs processes side by side, one thread each, and returns their JSON lines.

    Workers among them (`--worker`) first warm up, print "ready", and wait for a line.
    """
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    commands = [[str(part) for part in command] for command in commands]
    processes = [subprocess.Popen(command, env=threads(1), **pipes) for command in commands]
    workers = [process for process, command in zip(processes, commands) if "--worker" in command]

    def fail(process, reason):
        for other in processes:
            other.kill()
        lines = process.stderr.read().strip().splitlines() if not process.stderr.closed else []
        raise RuntimeError((lines or [reason])[-1])

    for process in workers:
        if not any(line.strip() == "ready" for line in process.stdout):
            fail(process, "ended before it was ready")
    for process in workers:
        process.stdin.write("go\n")
        process.stdin.flush()
    results = []
    for process in processes:
        out, error = process.communicate()
        line = next((line for line in out.splitlines() if line.startswith("{")), None)
        if line is None:
            for other in processes:
                other.kill()
            raise RuntimeError((error.strip().splitlines() or ["no result"])[-1])
        results.append(json.loads(line))
    return results
