"""An agent in Python as the program of a study: `calib run` then sweeps it as it does its own.

[agent]
kind = "external"
command = ["python3", "serve_agent.py"]
gamma = 0.9

[agent.parameters]
learning_rate = 1e-2
trace = 0.0

[sweep.grid]
learning_rate = [1e-3, 1e-2, 1e-1]
"""

from own_agents import LinearTd

from calib_rl.agents import serve

if __name__ == "__main__":
    serve(LinearTd)
