"""Value networks side by side: calib's stacks through libtorch beside PyTorch's, on the same device, interleaved.

    python3 scripts/peers/populations.py [--device cpu|cuda] [--runs N] [--learners N] [--steps N] [--rounds N] [--program FILE] [--python FILE]

Each of RUNS streams of 142 sensors has LEARNERS networks 142-256-256-1 that learn from the run's mini-batches of 256 transitions: gather the batch, v(s) and
v(s'), the semi-gradient of the mean of delta^2 / 2, Adam, and the prediction of the present state. The table has updates a second, one network's update
each, medians over the rounds, and what share of the bare products' rate that is: the eight batched products of an update alone, on the same device.

torch stacked   batched products and autograd, Adam written out for all networks at once
torch vmap      torch.func: vmap over grad of the loss of one network, the same Adam
calib native    one run after the other on one thread, without libtorch (with --device cpu only)

--program is a built example `populations_speed` of calib-torch, for a machine without Rust; --python one that has PyTorch.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import time

import common

PINNED = {"torch": "2.11.0", "numpy": "2.3.5"}
CPU_INDEX = "https://download.pytorch.org/whl/cpu"
SENSORS, UNITS, BATCH, GAMMA, ROWS = 142, 256, 256, 0.9, 2_000
SIZES = [SENSORS, UNITS, UNITS, 1]
PEERS = ["torch stacked", "torch vmap", "products"]


def worker(peer, device, runs, learners, steps):
    """Trains, and prints its updates per second."""
    import torch

    torch.manual_seed(1)
    torch.set_num_threads(1)
    networks, rows = runs * learners, 2 * BATCH + 1
    wait = torch.cuda.synchronize if device == "cuda" else lambda: None
    states = torch.rand(runs, ROWS, SENSORS, device=device)
    begins = (torch.arange(runs, device=device) * ROWS)[:, None]
    rates = torch.logspace(-6, -2, learners, device=device).repeat(runs)
    shapes = list(zip(SIZES, SIZES[1:]))
    weights = [torch.rand(networks, a, b, device=device) * 0.1 - 0.05 for a, b in shapes]
    biases = [torch.zeros(networks, 1, b, device=device) for _, b in shapes]
    parameters = [*weights, *biases]
    moments = [[torch.zeros_like(p) for p in parameters] for _ in range(2)]
    powers = [1.0, 1.0]

    def adam(gradients):
        powers[0] *= 0.9
        powers[1] *= 0.999
        with torch.no_grad():
            for parameter, gradient, mean, square in zip(parameters, gradients, *moments):
                mean.mul_(0.9).add_(gradient, alpha=0.1)
                square.mul_(0.999).addcmul_(gradient, gradient, value=0.001)
                scale = square.sqrt().mul_(1 / (1 - powers[1]) ** 0.5).add_(1e-8)
                parameter.sub_(mean.div(scale).mul_((rates / (1 - powers[0]))[:, None, None]))

    def gathered(step):
        starts = torch.randint(0, ROWS - 1, (runs, BATCH), device=device)
        present = torch.full((runs, 1), step % ROWS, device=device)
        index = torch.cat([starts, present, starts + 1], 1) + begins
        return states.view(-1, SENSORS)[index.view(-1)].view(runs, rows, SENSORS)

    def values(x, weights, biases):
        for layer in range(3):
            x = torch.baddbmm(biases[layer], x, weights[layer]) if x.dim() == 3 else x @ weights[layer] + biases[layer]
            x = torch.relu(x) if layer < 2 else x
        return x.squeeze(-1)

    def stacked(step):
        x = gathered(step)
        ahead = x[:, BATCH + 1 :, 0].repeat_interleave(learners, 0)
        with torch.enable_grad():
            for parameter in parameters:
                parameter.requires_grad_(True)
            v = values(x.repeat_interleave(learners, 0), weights, biases)
            targets = ahead + GAMMA * v[:, BATCH + 1 :].detach()
            loss = (targets - v[:, :BATCH]).square().mean(1).sum() / 2
            gradients = torch.autograd.grad(loss, parameters)
        adam(gradients)
        return v[:, BATCH].detach()

    def loss_of_one(own, x):
        v = values(x, own[:3], own[3:])
        targets = (x[BATCH + 1 :, 0] + GAMMA * v[BATCH + 1 :]).detach()
        return (targets - v[:BATCH]).square().mean() / 2, v[BATCH]

    of_all = torch.func.vmap(torch.func.grad(loss_of_one, has_aux=True))

    def vmapped(step):
        gradients, present = of_all(parameters, gathered(step).repeat_interleave(learners, 0))
        adam(gradients)
        return present

    def products(_):
        for (inputs, outputs), weight in zip(shapes, weights):
            x = ones[inputs]
            torch.bmm(x, weight)
            slope = ones[outputs][:, :BATCH]
            torch.bmm(x[:, :BATCH].transpose(1, 2), slope)
            if inputs != SENSORS:
                torch.bmm(slope, weight.transpose(1, 2))

    ones = {size: torch.rand(networks, rows, size, device=device) for size in {*SIZES}} if peer == "products" else {}
    update = {"torch stacked": stacked, "torch vmap": vmapped, "products": products}[peer]
    with torch.no_grad():
        for step in range(3):
            update(step)
        wait()
        clock = time.perf_counter()
        for step in range(steps):
            update(step)
        wait()
    seconds = time.perf_counter() - clock
    print(json.dumps({"updates_per_second": networks * steps / seconds, "device": str(torch.cuda.get_device_name(0)) if device == "cuda" else "cpu"}))


def result(command):
    """Returns the JSON line that a program prints."""
    ran = subprocess.run([str(part) for part in command], env=common.threads(1), capture_output=True, text=True)
    lines = [line for line in ran.stdout.splitlines() if line.startswith("{")]
    if ran.returncode or not lines:
        raise RuntimeError((ran.stderr.strip().splitlines() or ["no result"])[-1])
    return json.loads(lines[-1])


def built():
    """Builds the example with libtorch."""
    command = ["bash", "scripts/libtorch.sh", "cargo", "build", "--release", "--locked", "--quiet", "-p", "calib-torch"]
    subprocess.run([*command, "--features", "libtorch", "--example", "populations_speed"], check=True, cwd=common.ROOT)
    return common.target() / "release" / "examples" / "populations_speed"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu")
    parser.add_argument("--runs", type=int, default=None, help="default: 32 on a GPU, 2 on a processor")
    parser.add_argument("--learners", type=int, default=9)
    parser.add_argument("--steps", type=int, default=None, help="default: 400 on a GPU, 40 on a processor")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--program", type=pathlib.Path)
    parser.add_argument("--python")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    on_gpu = options.device == "cuda"
    runs, steps = options.runs or (32 if on_gpu else 2), options.steps or (400 if on_gpu else 40)
    if options.worker:
        return worker(options.worker, options.device, runs, options.learners, steps)
    program, python = options.program or built(), options.python
    if not python:
        python, _ = common.environment("torch", PINNED, None if on_gpu else CPU_INDEX)
    sizes = [runs, options.learners, steps]
    own = {"calib": [program, options.device, *sizes]}
    if not on_gpu:
        own["calib native"] = [program, "native", *sizes]
    flags = ["--device", options.device, "--runs", runs, "--learners", options.learners, "--steps", steps]
    commands = own | {peer: [python, __file__, "--worker", peer, *flags] for peer in PEERS}
    rates = {contender: [] for contender in commands}
    for _ in range(options.rounds):
        for contender in list(rates):
            try:
                rates[contender].append(result(commands[contender])["updates_per_second"])
            except RuntimeError as error:
                print(f"skipped: {contender}: {error}", file=sys.stderr)
                del rates[contender]
    print(f"{common.machine()}, {options.device}, {runs} runs x {options.learners} networks, {steps} steps, {options.rounds} rounds")
    print(f"  {'':16}{'updates/s':>12}{'calib is':>11}{'of products':>13}")
    for contender, rate in rates.items():
        ratio = statistics.median(mine / other for mine, other in zip(rates.get("calib", rate), rate))
        share = statistics.median(one / bare for one, bare in zip(rate, rates.get("products", rate)))
        print(f"  {contender:16}{statistics.median(rate):12.0f}{ratio:9.2f} x{share:12.0%}")
    return None


if __name__ == "__main__":
    sys.exit(main())
