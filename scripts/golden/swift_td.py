"""Reference values for crates/calib-agent: SwiftTD, from the authors' public code in C++.

    git clone https://github.com/khurramjaved96/SwiftTD swift-td && git -C swift-td checkout 22dca8c
    python3 scripts/golden/swift_td.py swift-td

Features and rewards are given; the reference is the value that the authors' dense implementation returns at each step
(before it has learnt from the transition that leads there), and its weights and logarithmic step sizes at the end. With a
meta step size of 0 and a bound that is never reached it is true online TD(lambda).
"""

import pathlib
import random
import subprocess
import sys
import tempfile

import layout

STEPS, WIDTH, GAMMA = 150, 4, 0.9
CASES = [
    {"lambda": 0.0, "learning_rate": 0.05, "rate_bound": 100.0, "rate_decay": 0.999, "meta_step_size": 0.0},
    {"lambda": 0.9, "learning_rate": 0.05, "rate_bound": 100.0, "rate_decay": 0.999, "meta_step_size": 0.0},
    {"lambda": 0.8, "learning_rate": 0.01, "rate_bound": 0.5, "rate_decay": 0.999, "meta_step_size": 1e-2},
    {"lambda": 0.95, "learning_rate": 0.2, "rate_bound": 0.1, "rate_decay": 0.99, "meta_step_size": 1e-3},
]
HARNESS = """
#include <cstdio>
#define private public
#include "SwiftTD.h"
int main() {
    int cases, steps, width;
    float gamma;
    std::scanf("%d %d %d %f", &cases, &steps, &width, &gamma);
    for (int c = 0; c < cases; c++) {
        float lambda, alpha, eta, decay, meta;
        std::scanf("%f %f %f %f %f", &lambda, &alpha, &eta, &decay, &meta);
        SwiftTDNonSparse agent(width, lambda, alpha, gamma, 1e-8f, eta, decay, meta);
        for (int t = 0; t < steps; t++) {
            std::vector<float> x(width);
            float reward;
            for (auto& value : x) std::scanf("%f", &value);
            std::scanf("%f", &reward);
            std::printf("%.9g ", agent.Step(x, reward));
        }
        for (float w : agent.w) std::printf("%.9g ", w);
        for (float b : agent.beta) std::printf("%.9g ", b);
        std::printf("\\n");
    }
}
"""


def main():
    code = pathlib.Path(sys.argv[1]) / "src" / "cpp"
    draw = random.Random(7)
    features, rewards = [], []
    state = [0.0] * (WIDTH - 1)
    for _ in range(STEPS):
        state = [round(0.8 * value + draw.uniform(-0.5, 0.5), 6) for value in state]
        # The last feature is the constant 1 of every linear agent of calib.
        features.append([*state, 1.0])
        rewards.append(round(0.5 + state[0] - 0.3 * state[1], 6))
    numbers = [len(CASES), STEPS, WIDTH, GAMMA]
    for case in CASES:
        numbers += [case[key] for key in ("lambda", "learning_rate", "rate_bound", "rate_decay", "meta_step_size")]
        for x, reward in zip(features, rewards):
            numbers += [*x, reward]
    with tempfile.TemporaryDirectory() as folder:
        source, program = pathlib.Path(folder) / "harness.cpp", pathlib.Path(folder) / "harness"
        source.write_text(HARNESS)
        command = ["g++", "-O1", "-ffp-contract=off", f"-I{code}", str(source), str(code / "SwiftTD.cpp"), "-o", str(program)]
        subprocess.run(command, check=True)
        text = " ".join(str(number) for number in numbers)
        lines = subprocess.run([program], input=text, capture_output=True, text=True, check=True).stdout.splitlines()
    cases = []
    for case, line in zip(CASES, lines):
        values = [float(value) for value in line.split()]
        cases.append(
            {
                **case,
                "values": values[:STEPS],
                "weights": values[STEPS : STEPS + WIDTH],
                "log_rates": values[STEPS + WIDTH :],
            }
        )
    golden = {"gamma": GAMMA, "features": features, "rewards": rewards, "cases": cases}
    target = pathlib.Path(__file__).parents[2] / "crates/calib-agent/tests/golden/swift_td.json"
    layout.write(target, golden)


main()
