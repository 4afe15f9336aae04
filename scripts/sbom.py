#!/usr/bin/env python3
"""What is in the command: every crate of the workspace and what they depend on, as CycloneDX 1.5, on stdout.

    python3 scripts/sbom.py [TARGET]

From `cargo metadata` and the checksums of Cargo.lock; dependencies of tests and of build scripts are not in it;
macros, which run while it is compiled, are. TARGET is by default Linux on x86-64.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def checksums() -> dict[tuple[str, str], str]:
    lock = (ROOT / "Cargo.lock").read_text()
    blocks = re.findall(r'\[\[package\]\]\nname = "(.+)"\nversion = "(.+)"\n(?:source = .+\n)?checksum = "(.+)"', lock)
    return {(name, version): checksum for name, version, checksum in blocks}


def main() -> None:
    target = sys.argv[1] if len(sys.argv) > 1 else "x86_64-unknown-linux-gnu"
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--offline", "--filter-platform", target]
    metadata = json.loads(subprocess.run(command, cwd=ROOT, check=True, capture_output=True).stdout)
    packages = {package["id"]: package for package in metadata["packages"]}
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    root = next(of for of, package in packages.items() if package["name"] == "calib-rl")

    def linked(of: str) -> list[str]:
        """Returns the packages that a package is linked from, without its test and build dependencies."""
        normal = lambda dependency: any(kind["kind"] is None for kind in dependency["dep_kinds"])
        return sorted({dependency["pkg"] for dependency in nodes[of]["deps"] if normal(dependency)})

    found, left = set(), [root]
    while left:
        of = left.pop()
        if of not in found:
            found.add(of)
            left += linked(of)
    known = checksums()
    address = lambda of: f"pkg:cargo/{packages[of]['name']}@{packages[of]['version']}"

    def component(of: str) -> dict:
        package = packages[of]
        told = {
            "type": "application" if of == root else "library",
            "bom-ref": address(of),
            "name": package["name"],
            "version": package["version"],
            "purl": address(of),
        }
        if package["license"]:
            # Old crates write "MIT/Apache-2.0".
            told["licenses"] = [{"expression": package["license"].replace("/", " OR ")}]
        if checksum := known.get((package["name"], package["version"])):
            told["hashes"] = [{"alg": "SHA-256", "content": checksum}]
        return told

    others = sorted(found - {root}, key=address)
    print(json.dumps({
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {"component": component(root)},
        "components": [component(of) for of in others],
        "dependencies": [{"ref": address(of), "dependsOn": [address(to) for to in linked(of)]} for of in [root, *others]],
    }, indent=1))


if __name__ == "__main__":
    main()
