"""Laplacian training: calib-represent beside PyTorch, the same step on the same shapes, interleaved.

    python3 scripts/peers/laplacian.py [--rounds N] [--updates N] [--device cpu|cuda]

One update: 256 pairs and 256 independent states through 142-256-256-64, the loss, its gradient, Adam. Random
states: what they are has no influence on the time. Every round runs every contender once, on one thread alone and then as
two such processes side by side (--processes); the table has updates a second of all processes together, medians over the
rounds. A ratio is the median of the rounds' ratios.
"""

import argparse
import json
import os
import platform
import statistics
import sys
import time

import common

PINNED = {"torch": "2.11.0", "numpy": "2.3.5"}
CPU_INDEX = "https://download.pytorch.org/whl/cpu"
COLUMNS, HIDDEN, DIMENSION, BATCH, ROWS = 142, 256, 64, 256, 20_000
BETA, ZETA = 5.0, 0.05
PEERS = {
    "torch eager": {},
    "torch fused Adam": {"fused": True},
    "torch compiled": {"fused": True, "compiled": True},
}


def worker(options, updates, device):
    """Warms up, prints "ready", trains when told, and prints its updates per second."""
    import torch

    torch.manual_seed(1)
    network = torch.nn.Sequential(
        torch.nn.Linear(COLUMNS, HIDDEN), torch.nn.ReLU(), torch.nn.Linear(HIDDEN, HIDDEN), torch.nn.ReLU(),
        torch.nn.Linear(HIDDEN, DIMENSION),
    ).to(device)
    states = torch.rand(ROWS, COLUMNS, device=device)
    adam = torch.optim.Adam(network.parameters(), lr=3e-4, fused=options.get("fused", False))

    def loss_of(rows):
        u, v, x = network(rows).split(BATCH)
        squared, norms = (x @ x.T) ** 2, (x**2).sum(1)
        # Means over i != j: all pairs without the diagonal.
        orthogonality = (squared.sum() - (norms**2).sum()) / (BATCH * (BATCH - 1))
        return ((u - v) ** 2).sum(1).mean() + BETA * (orthogonality - 2 * ZETA * norms.mean())

    if options.get("compiled"):
        loss_of = torch.compile(loss_of)

    def update():
        u = torch.randint(0, ROWS - 20, (BATCH,), device=device)
        v = u + 1 + torch.randint(0, 19, (BATCH,), device=device)
        loss = loss_of(states[torch.cat([u, v, torch.randint(0, ROWS, (BATCH,), device=device)])])
        adam.zero_grad(set_to_none=True)
        loss.backward()
        adam.step()

    wait = torch.cuda.synchronize if device == "cuda" else lambda: None
    for _ in range(20):
        update()
    wait()
    print("ready", flush=True)
    sys.stdin.readline()
    clock = time.perf_counter()
    for _ in range(updates):
        update()
    wait()
    print(json.dumps({"updates_per_second": updates / (time.perf_counter() - clock), "peak_kib": common.peak_kib()}), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--updates", type=int, default=1000, help="updates of each contender a round")
    parser.add_argument("--processes", type=int, nargs="+", default=sorted({1, os.cpu_count()}), help="how many at once")
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu", help="of PyTorch")
    parser.add_argument("--worker", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        peer, updates, device = options.worker
        return worker(PEERS[peer], int(updates), device)

    program = common.build("calib-represent", "train_speed")
    python, installed = common.environment("torch", PINNED, None if options.device == "cuda" else CPU_INDEX)
    print(f"{common.machine()}, one thread a process, {options.rounds} rounds of {options.updates} updates, commit {common.commit()}")
    print(", ".join(f"{name} {PINNED[name]}" for name in installed) + f", Python {platform.python_version()}, PyTorch on {options.device}")
    commands = {"calib": [program, COLUMNS, BATCH, options.updates]}
    if "torch" in installed:
        commands |= {peer: [python, __file__, "--worker", peer, options.updates, options.device] for peer in PEERS}
    for count in options.processes:
        rates = {contender: [] for contender in commands}
        for _ in range(options.rounds):
            for contender in list(rates):
                try:
                    done = common.together([commands[contender]] * count)
                    rates[contender].append(sum(result["updates_per_second"] for result in done))
                except RuntimeError as error:
                    print(f"skipped: {contender}: {error}", file=sys.stderr)
                    del rates[contender]
        print(f"\n{COLUMNS}-{HIDDEN}-{HIDDEN}-{DIMENSION}, batch {BATCH}, {count} process{'es' if count > 1 else ''}")
        print(f"  {'':18}{'updates/s':>11}{'calib is':>12}")
        for contender, rate in rates.items():
            ratio = statistics.median(mine / other for mine, other in zip(rates["calib"], rate))
            print(f"  {contender:18}{statistics.median(rate):11.0f}{ratio:10.2f} x")
        sys.stdout.flush()
    return None


if __name__ == "__main__":
    sys.exit(main())
