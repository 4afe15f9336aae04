"""TD(0) sweeps: calib-agent beside PyTorch and NumPy, the same agents on the same shapes, interleaved.

    python3 scripts/peers/td0.py [--rounds N] [--updates N] [--processes N ...]

Nine agents with nine learning rates learn from the same mini-batches of 256 transitions of 142 sensors: an MLP
142-256-256-1, or a linear function with bias. One update: gather the batch, v(s) and v(s'), the semi-gradient of the mean
of delta^2 / 2, Adam; and the prediction of the present state. Each process has one thread; the table has updates a
second, one agent's update each, of all processes together, medians over the rounds, and the median of the rounds' ratios. The
row "products" is the rate at which the matrix products of an update alone would run with calib's GEMM library.

torch eager     nine networks one after the other, torch.optim.Adam
torch fused     the same with Adam(fused=True)
torch compiled  the same with torch.compile over the loss
torch stacked   the nine networks as one batched product, Adam written out for all nine at once
numpy           linear only: nine weight vectors one after the other
numpy stacked   the nine of them as one matrix
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
SENSORS, UNITS, BATCH, GAMMA, STEPS = 142, 256, 256, 0.9, 20_000
RATES = [1e-6 * 10 ** (0.5 * index) for index in range(9)]
SIZES = {"mlp": [SENSORS, UNITS, UNITS, 1], "linear": [SENSORS, 1]}
PEERS = {
    "mlp": ["torch eager", "torch fused", "torch compiled", "torch stacked", "torch bf16"],
    "linear": ["torch eager", "torch fused", "torch stacked", "numpy", "numpy stacked"],
}


def torch_networks(sizes, fused, compiled, rounded):
    """Returns a function of (step, batch of steps) that updates each agent once."""
    import torch

    precision = lambda: torch.autocast("cpu", torch.bfloat16, enabled=rounded)
    torch.manual_seed(1)
    states = torch.rand(STEPS + 1, SENSORS)
    agents = []
    for rate in RATES:
        layers = [part for pair in zip(sizes, sizes[1:]) for part in (torch.nn.Linear(*pair), torch.nn.ReLU())][:-1]
        network = torch.nn.Sequential(*layers)
        agents.append((network, torch.optim.Adam(network.parameters(), lr=rate, fused=fused)))

    def loss_of(network, now, after):
        # Each has its own context: otherwise weights that were rounded
        # without gradients would be used again.
        with torch.no_grad(), precision():
            ahead = network(after)
        with precision():
            values = network(now)
        goal = after[:, 0] + GAMMA * ahead[:, 0]
        return (0.5 * (goal - values[:, 0]) ** 2).mean()

    if compiled:
        loss_of = torch.compile(loss_of)

    def update(step, batch):
        batch = torch.from_numpy(batch)
        present, now, after = states[step], states[batch], states[batch + 1]
        for network, adam in agents:
            with torch.no_grad(), precision():
                network(present)
            loss = loss_of(network, now, after)
            adam.zero_grad(set_to_none=True)
            loss.backward()
            adam.step()

    return update


def torch_stacked(sizes):
    import torch

    torch.manual_seed(1)
    count = len(RATES)
    states, rates = torch.rand(STEPS + 1, SENSORS), torch.tensor(RATES)[:, None, None]
    parameters = []
    for inputs, outputs in zip(sizes, sizes[1:]):
        bound = inputs**-0.5
        parameters += [torch.empty(count, inputs, outputs).uniform_(-bound, bound), torch.empty(count, 1, outputs).uniform_(-bound, bound)]
    for parameter in parameters:
        parameter.requires_grad_()
    means, squares = ([torch.zeros_like(parameter) for parameter in parameters] for _ in range(2))
    number = 0

    def values(rows):
        hidden = rows.expand(count, *rows.shape)
        for index in range(0, len(parameters), 2):
            hidden = torch.baddbmm(parameters[index + 1], hidden, parameters[index])
            hidden = torch.relu(hidden) if index + 2 < len(parameters) else hidden
        return hidden[:, :, 0]

    def update(step, batch):
        nonlocal number
        number += 1
        batch = torch.from_numpy(batch)
        now, after = states[batch], states[batch + 1]
        with torch.no_grad():
            ahead = values(torch.cat([after, states[step : step + 1]]))
            goal = after[:, 0] + GAMMA * ahead[:, :-1]
        (0.5 * (goal - values(now)) ** 2).mean(1).sum().backward()
        with torch.no_grad():
            gradients = [parameter.grad for parameter in parameters]
            torch._foreach_lerp_(means, gradients, 0.1)
            torch._foreach_mul_(squares, 0.999)
            torch._foreach_addcmul_(squares, gradients, gradients, 0.001)
            for parameter, mean, square in zip(parameters, means, squares):
                scale = (square / (1 - 0.999**number)).sqrt_().add_(1e-8)
                parameter -= rates / (1 - 0.9**number) * mean / scale
                parameter.grad = None

    return update


def numpy_linear(stacked):
    import numpy as np

    rng = np.random.default_rng(1)
    states = np.ones((STEPS + 1, SENSORS + 1), np.float32)
    states[:, :SENSORS] = rng.random((STEPS + 1, SENSORS), dtype=np.float32)
    rates = np.array(RATES, np.float32)[:, None]
    weights = rng.uniform(-1, 1, (len(RATES), SENSORS + 1)).astype(np.float32) / np.float32(SENSORS**0.5)
    means, squares, number = np.zeros_like(weights), np.zeros_like(weights), 0
    groups = [slice(None)] if stacked else [slice(index, index + 1) for index in range(len(RATES))]

    def update(step, batch):
        nonlocal number
        number += 1
        now, after = states[batch], states[batch + 1]
        ahead = (np.float32(GAMMA) * after - now).T
        for group in groups:
            weight, mean, square = weights[group], means[group], squares[group]  # views
            weight @ states[step]
            gradient = (after[:, 0] + weight @ ahead) @ now / np.float32(-BATCH)
            mean += np.float32(0.1) * (gradient - mean)
            square += np.float32(0.001) * (gradient * gradient - square)
            scale = np.sqrt(square / np.float32(1 - 0.999**number)) + np.float32(1e-8)
            weight -= rates[group] / np.float32(1 - 0.9**number) * mean / scale

    return update


def worker(kind, peer, updates):
    """Warms up, prints "ready", trains when told, and prints its updates per second."""
    import numpy as np

    if peer.startswith("numpy"):
        update = numpy_linear(peer == "numpy stacked")
    elif peer == "torch stacked":
        update = torch_stacked(SIZES[kind])
    else:
        update = torch_networks(SIZES[kind], peer in ("torch fused", "torch compiled"), peer == "torch compiled", peer == "torch bf16")
    rng = np.random.default_rng(2)
    for step in range(10):
        update(step, rng.integers(0, STEPS, BATCH))
    print("ready", flush=True)
    sys.stdin.readline()
    wall, processor = time.perf_counter(), time.process_time()
    for step in range(updates):
        update(step, rng.integers(0, max(step, BATCH), BATCH))
    rates = {
        "updates_per_second": len(RATES) * updates / (time.perf_counter() - wall),
        "updates_per_processor_second": len(RATES) * updates / (time.process_time() - processor),
    }
    print(json.dumps({**rates, "peak_kib": common.peak_kib()}), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--updates", type=int, default=100, help="of each agent of a PyTorch MLP a round; the faster do more")
    parser.add_argument("--processes", type=int, nargs="+", default=[os.cpu_count()], help="how many at once (one a core)")
    parser.add_argument("--kinds", nargs="+", choices=list(PEERS), default=list(PEERS))
    parser.add_argument("--worker", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        kind, peer, updates = options.worker
        return worker(kind, peer, int(updates))

    program = common.build("calib-agent", "td_speed")
    python, installed = common.environment("torch", PINNED, CPU_INDEX)
    print(f"{common.machine()}, one thread a process, {options.rounds} rounds, commit {common.commit()}")
    print(", ".join(f"{name} {PINNED[name]}" for name in installed) + f", Python {platform.python_version()}; {len(RATES)} agents a process, updates of one agent")
    for kind in options.kinds:
        # About the same time for each: linear agents are a hundred times faster, ours several times more.
        updates = options.updates * (1 if kind == "mlp" else 20)
        ours = updates * (4 if kind == "mlp" else 20)
        commands = {"calib": [program, kind, len(RATES), ours]}
        if kind == "mlp":
            commands["calib bf16"] = [program, "mlp-bf16", len(RATES), ours]
        for peer in PEERS[kind]:
            if peer.split()[0] in installed:
                commands[peer] = [python, __file__, "--worker", kind, peer, updates]
        for count in options.processes:
            table(kind, commands, count, options.rounds)
    return None


def table(kind, commands, count, rounds):
    results = {contender: [] for contender in commands}
    for _ in range(rounds):
        for contender in list(results):
            try:
                results[contender].append(common.together([commands[contender]] * count))
            except RuntimeError as error:
                print(f"skipped: {contender}: {error}", file=sys.stderr)
                del results[contender]
    sizes = "-".join(map(str, SIZES[kind]))
    print(f"\n{kind} {sizes}, batch {BATCH}, {count} process{'es' if count > 1 else ''}")
    print(f"  {'':16}{'updates/s':>12}{'/processor s':>14}{'calib is':>12}")
    wall = lambda result: sum(part["updates_per_second"] for part in result)
    rate = lambda result: statistics.mean(part["updates_per_processor_second"] for part in result)
    for contender, runs in results.items():
        ratio = statistics.median(rate(mine) / rate(other) for mine, other in zip(results["calib"], runs))
        print(f"  {contender:16}{statistics.median(map(wall, runs)):12.0f}{statistics.median(map(rate, runs)):14.0f}{ratio:10.2f} x")
    if kind == "mlp":
        ours = results["calib"]
        bare = lambda result: statistics.mean(part["gemm_updates_per_second"] for part in result)
        ratio = statistics.median(rate(mine) / bare(mine) for mine in ours)
        gflops = statistics.median(part["gemm_gflops"] for mine in ours for part in mine)
        print(f"  {'products':16}{'':12}{statistics.median(map(bare, ours)):14.0f}{ratio:10.2f} x   {gflops:.0f} GFLOP/s a process")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
