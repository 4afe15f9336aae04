"""Reference values for calib-nn's Adam with decoupled weight decay, in double precision.

The textbook algorithm (Kingma & Ba 2015; Loshchilov & Hutter 2019), plain Python.
Run: python3 scripts/golden/nn_adam.py > crates/calib-nn/tests/golden/adam.txt
"""

from math import sqrt

alpha, beta1, beta2, epsilon, decay = 0.05, 0.9, 0.999, 1e-8, 0.1
theta = [1.0, -2.0, 0.5]
m = [0.0] * 3
v = [0.0] * 3
for t in range(5):
    gradient = [p * (i + 1) + (t - 2.0) * 0.25 for i, p in enumerate(theta)]
    for i, g in enumerate(gradient):
        m[i] = beta1 * m[i] + (1 - beta1) * g
        v[i] = beta2 * v[i] + (1 - beta2) * g * g
        m_hat = m[i] / (1 - beta1 ** (t + 1))
        v_hat = v[i] / (1 - beta2 ** (t + 1))
        theta[i] = theta[i] * (1 - alpha * decay) - alpha * m_hat / (sqrt(v_hat) + epsilon)
    print(*(f"{value:.12f}" for value in theta))
