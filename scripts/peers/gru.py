"""GRU training: calib-dynamics beside PyTorch, the same step on the same shapes, interleaved, on one thread.

    python3 scripts/peers/gru.py [--rounds N] [--updates N] [--units N] [--batch N]

One update: BATCH sequences of 20 states of 142 columns through two layers of UNITS (torch.nn.GRU) and a linear head, the mean squared error of every
next state, its gradient through the whole sequence, Adam. Random states: what they are has no influence on the time. The table has updates a second,
medians over the rounds, and medians of the rounds' ratios.

torch          torch.nn.GRU, fused Adam
torch unfused  torch.nn.GRU, Adam as it is by default
"""

import argparse
import json
import platform
import statistics
import subprocess
import sys
import time

import common

PINNED = {"torch": "2.11.0", "numpy": "2.3.5"}
CPU_INDEX = "https://download.pytorch.org/whl/cpu"
COLUMNS, LENGTH = 142, 20
PEERS = {"torch": True, "torch unfused": False}


def worker(fused, units, batch, updates):
    """Trains, and prints its updates per second."""
    import torch

    torch.manual_seed(1)
    torch.set_num_threads(1)
    gru = torch.nn.GRU(COLUMNS, units, num_layers=2, batch_first=True)
    head = torch.nn.Linear(units, COLUMNS)
    adam = torch.optim.Adam([*gru.parameters(), *head.parameters()], lr=1e-3, fused=fused or None)
    states = torch.rand(LENGTH * batch + 200, COLUMNS)
    rows = (17 * torch.arange(batch))[:, None] + torch.arange(LENGTH)

    def update():
        adam.zero_grad(set_to_none=True)
        hidden, _ = gru(states[rows])
        loss = torch.nn.functional.mse_loss(head(hidden), states[rows + 1])
        loss.backward()
        adam.step()

    update()
    clock = time.perf_counter()
    for _ in range(updates):
        update()
    print(json.dumps({"updates_per_second": updates / (time.perf_counter() - clock)}))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--updates", type=int, default=4, help="updates of each contender a round")
    parser.add_argument("--units", type=int, default=512)
    parser.add_argument("--batch", type=int, default=256)
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    sizes = [options.units, options.batch, options.updates]
    if options.worker:
        return worker(PEERS[options.worker], *sizes)
    program = common.build("calib-dynamics", "gru_speed")
    python, installed = common.environment("torch", PINNED, CPU_INDEX)
    print(f"{common.machine()}, one thread, {options.rounds} rounds of {options.updates} updates, commit {common.commit()}")
    print(", ".join(f"{name} {PINNED[name]}" for name in installed) + f", Python {platform.python_version()}")
    commands = {"calib": [program, *sizes]}
    flags = ["--units", options.units, "--batch", options.batch, "--updates", options.updates]
    if "torch" in installed:
        commands |= {peer: [python, __file__, "--worker", peer, *flags] for peer in PEERS}
    rates = {contender: [] for contender in commands}
    for _ in range(options.rounds):
        for contender, command in commands.items():
            words = [str(word) for word in command]
            ran = subprocess.run(words, env=common.threads(1), capture_output=True, text=True, check=True)
            rates[contender].append(json.loads(ran.stdout.splitlines()[-1])["updates_per_second"])
    print(f"\n{COLUMNS}-{options.units}-{options.units}-{COLUMNS}, sequences of {LENGTH}, batch {options.batch}")
    print(f"  {'':18}{'updates/s':>11}{'calib is':>12}")
    for contender, rate in rates.items():
        ratio = statistics.median(mine / other for mine, other in zip(rates["calib"], rate))
        print(f"  {contender:18}{statistics.median(rate):11.2f}{ratio:10.2f} x")
    return None


if __name__ == "__main__":
    sys.exit(main())
