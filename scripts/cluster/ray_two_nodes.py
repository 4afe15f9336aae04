"""Two Ray nodes on this machine run a plan by the driver; one of them is lost when a third of the shards are done.

usage: ray_two_nodes.py PLAN CALIB      (calib_ray can be imported)
"""

import json
import os
import sys
import threading
import time
from argparse import Namespace
from pathlib import Path

os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
os.environ.setdefault("RAY_DEDUP_LOGS", "0")


import ray
from ray.cluster_utils import Cluster

import calib_ray


def main():
    plan, calib = Path(sys.argv[1]), sys.argv[2]
    read = json.loads((plan / "plan.json").read_text())
    memory = 2 << 30
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "memory": memory, "include_dashboard": False})
    # The driver is connected to the head, so the other node can be lost.
    ray.init(address=cluster.address, logging_level="ERROR")
    lost = cluster.add_node(num_cpus=1, memory=memory)
    cluster.wait_for_nodes()

    def lose():
        while len(list((plan / "shards").glob("*.units"))) < len(read["shards"]) // 3:
            time.sleep(0.05)
        cluster.remove_node(lost, allow_graceful=False)
        print("ray: one node is lost", flush=True)

    loser = threading.Thread(target=lose)
    loser.start()
    options = Namespace(plan=plan, calib=calib, ship=True, threads=1, attempts=10)
    failed = calib_ray.run_plan(ray, options, read)
    loser.join()
    # The head of the cluster notices a lost node after some seconds, when all work may be finished.
    until = time.monotonic() + 60
    while (nodes := sum(node["Alive"] for node in ray.nodes())) != 1 and time.monotonic() < until:
        time.sleep(0.2)
    ray.shutdown()
    cluster.shutdown()
    assert nodes == 1, f"{nodes} nodes are alive"
    sys.exit(calib_ray.INCOMPLETE if failed else 0)


main()
